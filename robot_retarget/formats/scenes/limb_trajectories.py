"""Format `ros-limb-trajectories`: a folder with a ROS 2 JointTrajectory for each limb, for robots with a controller per limb.

`left_arm.yaml`, `right_arm.yaml`, `left_leg.yaml`, `right_leg.yaml`, `head.yaml` and `torso.yaml`, those that the robot has, each
as in `ros-joint-trajectory`. All have the same times. Fingers are joints of their arm.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.documents import read_text
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.scenes.joint_trajectory import read_message, write_message
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.anatomy import LIMBS, joints_by_limb
from robot_retarget.robot.recognise import recognise

FILES = tuple(f"{limb}.yaml" for limb in (*LIMBS, "torso"))


def write(motion: RobotMotion, path: Path) -> None:
    """Fill the folder (extra `formats`)."""
    for limb, joints in joints_by_limb(motion.robot, recognise(motion.robot)).items():
        columns = [motion.joints.index(joint) for joint in joints]
        write_message(path / f"{limb}.yaml", joints, motion.angles[:, columns], motion.fps)


def read(source: TrajectorySource) -> Columns:
    """Read the messages of all limbs.

    Raises:
        TrajectoryError: one is no JointTrajectory, or they have not the same times.
    """
    files = [source.path / name for name in FILES if (source.path / name).is_file()]
    limbs = [read_message(read_text(file, TrajectoryError)) for file in files]
    angles = [limb.angles for limb in limbs if limb.angles is not None]
    if len({(len(table), limb.fps) for table, limb in zip(angles, limbs, strict=True)}) != 1:
        raise TrajectoryError("the limbs have other numbers of points or other times")
    names = tuple(name for limb in limbs for name in limb.names or ())
    return Columns(np.concatenate(angles, axis=1), names, fps=limbs[0].fps)


FORMAT = TrajectoryFormat(
    name="ros-limb-trajectories",
    suffix="",
    description="ROS 2 JointTrajectory for each limb, in a folder; no root",
    write=write,
    read=read,
    claims=lambda source: any((source.path / name).is_file() for name in FILES),
    readers="ROS 2 (a joint_trajectory_controller per limb)",
    root=False,
    quaternion="none",
)
