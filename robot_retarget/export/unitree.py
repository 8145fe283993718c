"""Format `unitree`: rows as in Unitree's retargeted LAFAN1, read by mjlab, whole_body_tracking and unitree_rl_lab.

No header, 30 frames per second; root x y z [m], quaternion **x y z w**, then the hinges in the model's order [rad].
"""

from pathlib import Path

import numpy as np

from robot_retarget.errors import UsageError
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import resample
from robot_retarget.trajectory import Trajectory

FPS = 30.0
NUMBER = "%.8f"


def write(trajectory: Trajectory, robot: Robot, path: Path) -> None:
    """Write the rows, brought to 30 frames per second.

    Raises:
        UsageError: the robot's root is not a free joint.
    """
    if not robot.floating:
        raise UsageError(f"format 'unitree' needs a robot with a free root; the root of {robot.name!r} is not free")
    qpos = resample(trajectory, robot, FPS).qpos
    root = robot.root_address
    order = root + np.array([0, 1, 2, 4, 5, 6, 3])
    np.savetxt(path, qpos[:, np.concatenate([order, robot.qpos_index])], fmt=NUMBER, delimiter=",")
