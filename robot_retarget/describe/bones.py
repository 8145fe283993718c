"""How long bones are."""

import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen


def bone_lengths(positions: Floats, parents: Ints) -> Floats:
    """(K,) of the bones to the parents in the middle of positions (T, K, 3), 0 at the root [m]."""
    lengths = np.where(parents >= 0, np.linalg.norm(positions - positions[:, parents], axis=2), 0.0)
    return frozen(np.median(lengths, axis=0))
