"""Format `kimodo`: rows as Kimodo writes for the G1.

No header, 30 frames per second; root x y z [m], quaternion **w x y z**: the shape of Unitree's rows, in another order, then the hinges in the model's order [rad].
"""

from pathlib import Path

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.formats.text.rows import looks_like_rows, read_rows, write_rows


def write(motion: RobotMotion, path: Path) -> None:
    """Write the rows."""
    write_rows(motion, path, "kimodo", scalar_first=True)


def read(source: TrajectorySource) -> Columns:
    """Read the rows."""
    return read_rows(source, scalar_first=True)


FORMAT = TrajectoryFormat(
    name="kimodo",
    suffix=".csv",
    description="Kimodo G1 rows without a header: xyz, quaternion wxyz, joints",
    write=write,
    read=read,
    claims=looks_like_rows,
    readers="Kimodo's tools",
    fps=30.0,
    complete=False,
    ordered=True,
    quaternion="wxyz",
)
