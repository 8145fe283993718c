"""Tables without a header: root x y z [m], a quaternion, joints [rad]. Several formats are that and differ in the quaternion."""

from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.formats.columns import FIRST_LAST, LAST_FIRST, Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import ROWS, TrajectoryFormat, TrajectorySource, declared

NUMBER = "%.12g"
ROOT = 7


def rows_format(name: str) -> TrajectoryFormat:
    """Return a format of rows at 30 frames a second; the quaternion is `wxyz` or `xyzw`."""
    from_file, to_file = (
        (slice(None),) * 2 if ROWS[name].get("quaternion", "wxyz") == "wxyz" else (FIRST_LAST, LAST_FIRST)
    )

    def write(motion: RobotMotion, path: Path) -> None:
        rows = np.column_stack([motion.position, motion.quaternion[:, to_file], motion.angles])
        np.savetxt(path, rows, fmt=NUMBER, delimiter=",")

    def read(source: TrajectorySource) -> Columns:
        rows = number_rows(source)
        return Columns(rows[:, ROOT:], source.names(), rows[:, :3], rows[:, 3:ROOT][:, from_file], source.sidecar_fps)

    return declared(name, write, read, looks_like_rows)


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


UNITREE, KIMODO, PROTOMOTIONS_CSV = map(rows_format, ("unitree", "kimodo", "protomotions-csv"))
