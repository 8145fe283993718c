"""Axes of joints and links: by custom they lie along those of a body that stands upright."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats

CUBE = Rotation.create_group("O")
BENT = 0.2
"""Angles with a smaller sine count as 0 [rad]: of a straight elbow or knee, which shows no axis, of a level foot or head, of a
hand along the axes of its link."""


def snapped_to_axes(turn: Floats, most: float) -> Floats:
    """The nearest of the 24 rotations (3, 3) that take axes to axes, if it is within `most` [rad] of `turn`; else `turn` itself.

    Args:
        turn: (3, 3) rotation.
        most: largest angle [rad].
    """
    turns = CUBE.inv() * Rotation.from_matrix(turn)
    nearest = int(np.argmin(turns.magnitude()))
    return CUBE[nearest].as_matrix() if turns[nearest].magnitude() < most else turn
