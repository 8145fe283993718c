"""Format `unitree`: rows as in Unitree's retargeted LAFAN1.

No header, 30 frames per second; root x y z [m], quaternion **x y z w**, then the hinges in the model's order [rad].
"""

from pathlib import Path

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.formats.text.rows import looks_like_rows, read_rows, write_rows


def write(motion: RobotMotion, path: Path) -> None:
    """Write the rows."""
    write_rows(motion, path, "unitree", scalar_first=False)


def read(source: TrajectorySource) -> Columns:
    """Read the rows."""
    return read_rows(source, scalar_first=False)


FORMAT = TrajectoryFormat(
    name="unitree",
    suffix=".csv",
    description="Unitree LAFAN1 rows without a header: xyz, quaternion xyzw, joints",
    write=write,
    read=read,
    claims=looks_like_rows,
    readers="mjlab and whole_body_tracking (csv_to_npz), unitree_rl_lab",
    fps=30.0,
    complete=False,
    ordered=True,
    quaternion="xyzw",
)
