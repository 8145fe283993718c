"""Motions that stand, and motions that must not pass."""

from collections.abc import Mapping, Sequence

import numpy as np
from made_trajectories import hold

from robot_retarget.robot import Robot, load_robot
from robot_retarget.trajectory import Trajectory


def at_times(
    robot: Robot, angles: Mapping[str, Sequence[float]], times: Sequence[float], fps: float = 50.0
) -> Trajectory:
    """The standing pose with some joints straight from angle to angle [rad] at times [s]."""
    held = hold(robot, times[-1] - times[0], fps)
    qpos, frames = held.qpos.copy(), np.arange(len(held)) / fps
    for joint, values in angles.items():
        qpos[:, robot.qpos_index[robot.joint_names.index(joint)]] = np.interp(frames, times, values)
    return Trajectory(qpos, fps, robot.joint_names, robot.name, "made")


def bob(seconds: float = 4.0) -> Trajectory:
    """A slow squat of the OP3-class robot on both feet: hips, knees and ankles share the bend."""
    robot = load_robot("op3")
    deep = 0.25 * (1 - np.cos(2 * np.pi * np.arange(round(seconds * 50) + 1) / 100)) / 2
    qpos = hold(robot, seconds).qpos.copy()
    bend = {"hip_pitch": (-1, 1), "knee": (2, -2), "ank_pitch": (1, -1)}
    for joint, signs in bend.items():
        for side, sign in zip("lr", signs, strict=True):
            qpos[:, robot.qpos_index[robot.joint_names.index(f"{side}_{joint}")]] += sign * deep
    qpos[:, 2] += 0.22 * (np.cos(0.36 + deep) - np.cos(0.36))
    return Trajectory(qpos, 50, robot.joint_names, "op3", "bob")


def lean(robot: Robot, degrees: float) -> Trajectory:
    """Both ankles tip the whole robot forward in a second, and hold it there."""
    angle = np.radians(degrees)
    ankles = {joint: robot.joint_names.index(joint) for joint in ("l_ank_pitch", "r_ank_pitch")}
    stand = robot.standing()[robot.qpos_index]
    ends = {j: [stand[k], stand[k] + (-angle if j[0] == "l" else angle)] for j, k in ankles.items()}
    return at_times(robot, {j: [a, b, b] for j, (a, b) in ends.items()}, [0.0, 1.0, 3.0])


def kick(robot: Robot) -> Trajectory:
    """The left leg swings up to the front in a fifth of a second, with no weight shifted before."""
    legs = {"l_hip_pitch": [-0.32, -0.32, -1.2, -1.2, -0.32], "l_knee": [0.72, 1.4, 0.0, 0.0, 0.72]}
    return at_times(robot, legs, [0.0, 0.3, 0.5, 1.5, 2.5])
