"""Robots and motions that the tests of formats write and read."""

from functools import cache

import numpy as np
from made_trajectories import wander
from shared_files import SHARED

from robot_retarget.robot import load_robot
from robot_retarget.robot.model import Robot
from robot_retarget.trajectory import Trajectory

ROBOTS = {
    "op3": "op3",
    "g1": SHARED / "robots/unitree_g1/unitree_g1.xml",
    "toddlerbot": SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml",
}
THERE = [name for name, path in ROBOTS.items() if path == "op3" or path.is_file()]


@cache
def robot_called(name: str) -> Robot:
    return load_robot(ROBOTS[name])


@cache
def motion_of(name: str, fps: float = 50.0) -> Trajectory:
    """Every joint on its own sine, the root travelling and turning about a slanted axis."""
    robot = robot_called(name)
    made = wander(robot, frames=14, fps=fps)
    qpos = made.qpos.copy()
    half = 0.9 + 1.3 * np.arange(len(qpos)) / fps
    axis = np.array([0.36, -0.48, 0.8])
    qpos[:, 3] = np.cos(half)
    qpos[:, 4:7] = np.sin(half)[:, None] * axis
    return Trajectory(qpos, fps, robot.joint_names, robot.name, "made")
