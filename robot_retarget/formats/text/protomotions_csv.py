"""Format `protomotions-csv`: rows that ProtoMotions converts to its `.motion`.

No header, 30 frames per second; root x y z [m], quaternion **w x y z**, then the hinges in the model's order [rad].
"""

from pathlib import Path

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.formats.text.rows import looks_like_rows, read_rows, write_rows


def write(motion: RobotMotion, path: Path) -> None:
    """Write the rows."""
    write_rows(motion, path, "protomotions-csv", scalar_first=True)


def read(source: TrajectorySource) -> Columns:
    """Read the rows."""
    return read_rows(source, scalar_first=True)


FORMAT = TrajectoryFormat(
    name="protomotions-csv",
    suffix=".csv",
    description="ProtoMotions rows without a header: xyz, quaternion wxyz, joints",
    write=write,
    read=read,
    claims=looks_like_rows,
    readers="ProtoMotions (data/scripts, csv to motion)",
    fps=30.0,
    complete=False,
    ordered=True,
    quaternion="wxyz",
)
