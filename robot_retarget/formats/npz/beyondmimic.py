"""Format `beyondmimic`: what whole_body_tracking's `csv_to_npz.py` makes in Isaac Lab.

Joints and bodies **breadth first**; `body_lin_vel_w` is that of the bodies' centres of mass, as Isaac Lab has it. Root and
joint velocities by central differences over two frames, bodies moved by them.
"""

from pathlib import Path

import numpy as np

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz.tracking import claims_tracking, read_tracking, write_tracking
from robot_retarget.formats.orders import breadth_first_bodies, breadth_first_hinges
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.model import Robot


def write(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    hinges, bodies = breadth_first_hinges(motion.robot), breadth_first_bodies(motion.robot)
    write_tracking(motion, path, "beyondmimic", hinges, bodies, mass=True)


def read(source: TrajectorySource) -> Columns:
    """Read the archive."""
    return read_tracking(source, breadth_first_hinges(source.robot), (_depth_first(source.robot), "mjlab"))


def claims(source: TrajectorySource) -> bool:
    """Whether the file has the keys and the breadth-first order."""
    return claims_tracking(source, breadth_first_hinges(source.robot), _depth_first(source.robot))


def _depth_first(robot: Robot) -> np.ndarray:
    return np.arange(len(robot.joint_names))


FORMAT = TrajectoryFormat(
    name="beyondmimic",
    suffix=".npz",
    description="joints and bodies breadth first, with velocities",
    write=write,
    read=read,
    claims=claims,
    readers="whole_body_tracking (BeyondMimic)",
    fps=50.0,
)
