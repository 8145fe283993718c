"""Trajectories made from formulas, for tests of the stages that read them."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from robot_retarget.robot import Robot
from robot_retarget.robot.model import robot_from_model
from robot_retarget.trajectory import Trajectory


def hold(robot: Robot, seconds: float = 1.0, fps: float = 50.0, qpos: np.ndarray | None = None) -> Trajectory:
    """One pose, the standing one unless another is given, for a while."""
    pose = robot.standing() if qpos is None else qpos
    return Trajectory(np.tile(pose, (round(seconds * fps) + 1, 1)), fps, robot.joint_names, robot.name, "hold")


def lifted(trajectory: Trajectory, height: np.ndarray | float) -> Trajectory:
    """A trajectory higher by a height, or by (T,) heights [m]."""
    qpos = trajectory.qpos.copy()
    qpos[:, 2] += height
    return replace(trajectory, qpos=qpos)


def swing(robot: Robot, joint: str, amplitude: float, hertz: float, seconds: float, fps: float = 100.0) -> Trajectory:
    """The standing pose with one joint on a sine [rad] about it."""
    held = hold(robot, seconds, fps)
    qpos = held.qpos.copy()
    times = np.arange(len(qpos)) / fps
    qpos[:, robot.qpos_index[robot.joint_names.index(joint)]] += amplitude * np.sin(2 * np.pi * hertz * times)
    return Trajectory(qpos, fps, robot.joint_names, robot.name, "swing")


def wander(robot: Robot, frames: int = 40, fps: float = 50.0, seed: int = 3) -> Trajectory:
    """Every coordinate on its own sine within its range, the free root turning."""
    rng = np.random.default_rng(seed)
    times = np.arange(frames)[:, None] / fps
    qpos = np.tile(robot.standing(), (frames, 1))
    middle, half = (robot.lower + robot.upper) / 2, (robot.upper - robot.lower) / 2
    hertz = rng.uniform(0.2, 1.0, len(middle))
    qpos[:, robot.qpos_index] = middle + 0.8 * half * np.sin(2 * np.pi * hertz * times)
    if robot.floating:
        qpos[:, :3] += np.column_stack([0.3 * times, 0.1 * np.sin(times), 0.02 * np.cos(times)])
        yaw = 2.5 * times[:, 0]
        qpos[:, 3:7] = np.column_stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)])
    return Trajectory(qpos, fps, robot.joint_names, robot.name, "wander")


def robot_of(mjcf: str, path: Path, name: str = "made") -> Robot:
    """A robot from MJCF text, kept at `path`."""
    path.write_text(mjcf, encoding="utf-8")
    return robot_from_model(mujoco.MjModel.from_xml_path(str(path)), path, name)


RAIL = """<mujoco><worldbody><body name="cart"><joint name="travel" type="slide" axis="1 0 0"/>
<joint name="lift" type="slide" axis="0 0 1"/><geom size=".1"/><body name="arm" pos="0 0 .2">
<joint name="shoulder, left" type="hinge" axis="0 1 0" range="-90 90"/><geom type="capsule" fromto="0 0 0 0 0 .3" size=".03"/>
</body></body></worldbody></mujoco>"""
"""A robot on two slides with one hinge whose name needs quoting."""
