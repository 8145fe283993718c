"""Orders of the root's quaternion: the one a format has, and the other that some programs write into the same file."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError, known
from robot_retarget.robot.model import Robot

LAST_FIRST = (1, 2, 3, 0)
"""w x y z → x y z w."""
FIRST_LAST = (3, 0, 1, 2)
"""x y z w → w x y z."""
ORDERS = ("wxyz", "xyzw")
UPRIGHT = 0.5
"""Gain of uprightness in the other order that makes the order doubtful [cosine of the root's lean]."""


def reordered(quaternion: Floats, format: str, given: str) -> Floats:
    """(T, 4) w x y z from quaternions that were read in the format's order and are in the user's order.

    Raises:
        UsageError: the order is unknown, or the format holds no quaternion.
    """
    if given not in ORDERS or format not in ORDERS:
        what = "the format holds no quaternion" if format not in ORDERS else f"no order {given!r} of quaternions"
        raise UsageError(f"--quaternion: {what}; {known(ORDERS)}")
    if given == format:
        return quaternion
    return quaternion[:, LAST_FIRST if format == "xyzw" else FIRST_LAST]


def doubt(quaternion: Floats, format: str, robot: Robot) -> tuple[str, ...]:
    """A sentence where the robot would stand far more upright if the quaternions were in the other order."""
    if format not in ORDERS or not robot.floating:
        return ()
    other = ORDERS[1 - ORDERS.index(format)]
    read, swapped = (_upright(values, robot) for values in (quaternion, reordered(quaternion, format, other)))
    if swapped < read + UPRIGHT:
        return ()
    return (f"Read as {format} the robot leans or lies; as {other} it would stand: if so, say --quaternion {other}.",)


def _upright(quaternion: Floats, robot: Robot) -> float:
    """Median cosine between the vertical and the root's axis that is vertical in the standing pose."""
    start = robot.root_address + 3
    stands = Rotation.from_quat(robot.standing()[start : start + 4], scalar_first=True)
    turns = Rotation.from_quat(quaternion, scalar_first=True)
    return float(np.median((turns * stands.inv()).apply([0.0, 0.0, 1.0])[:, 2]))
