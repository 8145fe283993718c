"""Trees over joints: put in order, or found where nobody wrote them down."""

import numpy as np
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from robot_retarget.arrays import Floats, Ints
from robot_retarget.errors import MotionError


def sorted_tree(parents: Ints) -> tuple[Ints, Ints]:
    """The joints in an order with parents before children: the new parents, and the old index of each joint.

    Raises:
        MotionError: the parents form a ring.
    """
    depth = np.zeros(len(parents), dtype=int)
    above = np.array(parents)
    for _ in range(len(parents)):
        depth += above >= 0
        above = np.where(above >= 0, parents[np.maximum(above, 0)], -1)
    if (above >= 0).any():
        raise MotionError("the parents form a ring; expected a tree with −1 at its root")
    order = np.arange(len(parents)) if np.all(parents < np.arange(len(parents))) else np.argsort(depth, kind="stable")
    place = np.argsort(order)
    return np.where(parents[order] < 0, -1, place[np.maximum(parents[order], 0)]), order


def infer_parents(positions: Floats, root: int = 0) -> Ints:
    """The tree whose bones change least over (T, J, 3) positions and are shortest: a minimum spanning tree."""
    apart = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=3)
    cost = apart.std(axis=0) + 0.1 * apart.mean(axis=0) + 1e-9
    tree = minimum_spanning_tree(cost)
    _, parents = breadth_first_order(tree, root, directed=False)
    return np.where(parents < 0, -1, parents).astype(np.int64)
