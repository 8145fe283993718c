"""Poses between moments: the root turns along the rotations between its poses."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.robot import load_robot
from robot_retarget.solver.candidates import interpolated


def test_the_root_turns_along_the_rotations_between_its_poses() -> None:
    robot, times = load_robot("op3"), np.arange(0, 41, 10)
    turn = Rotation.from_rotvec(np.outer(np.arange(41) / 60, [0.3, 0.2, 1.5]))
    poses = np.repeat(robot.neutral()[None], 41, axis=0)
    poses[:, 3:7] = turn.as_quat(scalar_first=True)
    poses[10::20, 3:7] *= -1  # the same rotations
    found = np.array(interpolated(robot, times, list(poses[times])))
    away = turn.inv() * Rotation.from_quat(found[:, 3:7], scalar_first=True)
    assert away.magnitude().max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:7], axis=1), 1.0)
