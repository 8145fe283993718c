"""Format `mjlab`: what mjlab's `csv_to_npz.py` makes.

Joints and bodies **depth first**, as MuJoCo has them; `body_lin_vel_w` is that of the bodies' frames. Root and joint
velocities by central differences over two frames, bodies moved by them. mjlab does not read `fps`: it plays a frame a step.
"""

from pathlib import Path

import numpy as np

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.npz.tracking import claims_tracking, read_tracking, write_tracking
from robot_retarget.formats.orders import breadth_first_hinges, robot_bodies
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource


def write(motion: RobotMotion, path: Path) -> None:
    """Write the archive."""
    hinges = np.arange(len(motion.robot.joint_names))
    write_tracking(motion, path, "mjlab", hinges, robot_bodies(motion.robot), mass=False)


def read(source: TrajectorySource) -> Columns:
    """Read the archive."""
    hinges = np.arange(len(source.robot.joint_names))
    return read_tracking(source, hinges, (breadth_first_hinges(source.robot), "beyondmimic"))


def claims(source: TrajectorySource) -> bool:
    """Whether the file has the keys and the depth-first order."""
    hinges = np.arange(len(source.robot.joint_names))
    return claims_tracking(source, hinges, breadth_first_hinges(source.robot))


FORMAT = TrajectoryFormat(
    name="mjlab",
    suffix=".npz",
    description="joints and bodies depth first, with velocities",
    write=write,
    read=read,
    claims=claims,
    readers="mjlab (tracking tasks)",
    fps=50.0,
)
