"""Trees over joints in an order with parents before children."""

import numpy as np

from robot_retarget.base.arrays import Ints


def sorted_tree(parents: Ints) -> tuple[Ints, Ints]:
    """The joints in an order with parents before children: the new parents, and the old index of each joint.

    Raises:
        ValueError: the parents form a ring.
    """
    depth = np.zeros(len(parents), dtype=int)
    above = np.array(parents)
    for _ in range(len(parents)):
        depth += above >= 0
        above = np.where(above >= 0, parents[np.maximum(above, 0)], -1)
    if (above >= 0).any():
        raise ValueError("the parents form a ring; expected a tree with −1 at its root")
    order = np.arange(len(parents)) if np.all(parents < np.arange(len(parents))) else np.argsort(depth, kind="stable")
    place = np.argsort(order)
    return np.where(parents[order] < 0, -1, place[np.maximum(parents[order], 0)]), order
