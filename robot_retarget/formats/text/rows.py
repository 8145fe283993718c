"""Tables without a header: root x y z [m], a quaternion, joints [rad]. Several formats are that and differ in the quaternion."""

from pathlib import Path

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import TrajectoryError
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.quaternions import FIRST_LAST, LAST_FIRST
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource

NUMBER = "%.12g"
ROOT = 7


def write_rows(motion: RobotMotion, path: Path, format: str, scalar_first: bool) -> None:
    """Write a row a frame, the quaternion w x y z or x y z w."""
    motion.require_plain(format)
    quaternion = motion.quaternion if scalar_first else motion.quaternion[:, LAST_FIRST]
    np.savetxt(path, np.column_stack([motion.position, quaternion, motion.angles]), fmt=NUMBER, delimiter=",")


def read_rows(source: TrajectorySource, scalar_first: bool) -> Columns:
    """Read them."""
    rows = number_rows(source)
    quaternion = rows[:, 3:ROOT] if scalar_first else rows[:, 3:ROOT][:, FIRST_LAST]
    return Columns(rows[:, ROOT:], source.names(), rows[:, :3], quaternion, source.sidecar_fps)


def number_rows(source: TrajectorySource, skip: int = 0) -> Floats:
    """(T, C) the numbers of a table.

    Raises:
        TrajectoryError: a line that is not numbers or has another width, or fewer columns than a root has.
    """
    lines = source.text.split("\n")
    try:
        rows = np.loadtxt(lines[skip:], delimiter=",", ndmin=2)
    except ValueError as error:
        raise TrajectoryError(f"not a table of numbers: {error}") from error
    if not rows.size:
        raise TrajectoryError("no rows")
    if rows.shape[1] <= ROOT:
        raise TrajectoryError(f"{rows.shape[1]} columns; a root takes {ROOT} and every joint one")
    return rows


def looks_like_rows(source: TrajectorySource) -> bool:
    """Whether a file is a table of numbers whose columns 3 to 6 are a unit quaternion, in either order."""
    fields = source.head.split(",")
    try:
        first = np.array([float(field) for field in fields])
    except ValueError:
        return False
    return len(first) > ROOT and abs(float(np.linalg.norm(first[3:ROOT])) - 1) < 0.01
