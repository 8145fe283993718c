"""Trajectories between their frames: configurations at any time, other frame rates, joint velocities."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.robot.model import FREE, Robot
from robot_retarget.trajectory import Trajectory

FRAME_ROUNDING = 1e-9
"""Frame times are whole multiples of 1 / fps up to this part of a frame."""


def require_same_robot(trajectory: Trajectory, robot: Robot) -> None:
    """Check that a trajectory's columns are this robot's.

    Raises:
        TrajectoryError: another number of joints or of coordinates, or the first joint that has another name.
    """
    of = f"the trajectory is of {trajectory.robot or 'another robot'!r}, not of {robot.name!r}"
    theirs, ours = trajectory.joint_names, robot.joint_names
    for k, (there, here) in enumerate(zip(theirs, ours, strict=False)):
        if there != here:
            raise TrajectoryError(f"{of}: its joint {k} is {there!r}, here {here!r}")
    if len(theirs) != len(ours):
        raise TrajectoryError(f"{of}: it has {len(theirs)} joints, here {len(ours)}")
    if trajectory.qpos.shape[1] != robot.model.nq:
        raise TrajectoryError(f"{of}: it has {trajectory.qpos.shape[1]} coordinates, here {robot.model.nq}")


def sample(trajectory: Trajectory, robot: Robot, times: Floats) -> Floats:
    """Configurations (N, nq) at times (N,) [s], straight between frames; quaternions by slerp, held past both ends.

    Neighbouring quaternions come with the same sign, so that q and −q never stand side by side.

    Args:
        times: (N,) [s].
    """
    frames = np.arange(len(trajectory)) / trajectory.fps
    at = np.clip(times, 0.0, frames[-1])
    qpos = _straight(trajectory.qpos, frames, at)
    for start in _quaternions(robot):
        qpos[:, start : start + 4] = _slerp(frames, trajectory.qpos[:, start : start + 4], at)
    return qpos


def sample_hinges(trajectory: Trajectory, robot: Robot, times: Floats) -> Floats:
    """Hinge angles (N, n) [rad] as `sample` has them, without the root.

    Args:
        times: (N,) [s].
    """
    frames = np.arange(len(trajectory)) / trajectory.fps
    return _straight(trajectory.qpos[:, robot.qpos_index], frames, np.clip(times, 0.0, frames[-1]))


def resample(trajectory: Trajectory, robot: Robot, fps: float) -> Trajectory:
    """The trajectory at another frame rate, without goals; its last frame is the last that fits before the end.

    Args:
        fps: the new rate [1/s].

    Raises:
        UsageError: the rate is not positive.
        TrajectoryError: it belongs to another robot.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise UsageError(f"frames per second must be positive, got {fps}")
    require_same_robot(trajectory, robot)
    times = np.arange(int(np.floor(trajectory.duration * fps + FRAME_ROUNDING)) + 1) / fps
    source = np.interp(times, np.arange(len(trajectory)) / trajectory.fps, trajectory.source_time)
    scene = None if trajectory.scene is None else trajectory.scene.resampled(times * trajectory.fps)
    return trajectory.altered(qpos=sample(trajectory, robot, times), fps=fps, source_time=source, scene=scene)


def joint_velocities(trajectory: Trajectory, robot: Robot) -> Floats:
    """Velocities (T − 1, n) of the hinges from each frame to the next [rad/s]."""
    return np.diff(trajectory.qpos[:, robot.qpos_index], axis=0) * trajectory.fps


def range_excess(trajectory: Trajectory, robot: Robot) -> Floats:
    """(T, n) how far each hinge is beyond its range, 0 inside [rad]."""
    angles = trajectory.qpos[:, robot.qpos_index]
    return np.maximum(robot.lower - angles, angles - robot.upper).clip(0)


def _straight(values: Floats, frames: Floats, at: Floats) -> Floats:
    left = np.clip(np.searchsorted(frames, at) - 1, 0, max(len(frames) - 2, 0))
    right = np.minimum(left + 1, len(frames) - 1)
    length = frames[1] if len(frames) > 1 else 1.0
    share = ((at - frames[left]) / length)[:, None]
    return values[left] * (1 - share) + values[right] * share


def _quaternions(robot: Robot) -> list[int]:
    """Where quaternions begin in qpos."""
    model = robot.model
    return [int(model.jnt_qposadr[j]) + 3 for j in range(model.njnt) if model.jnt_type[j] == FREE]


def _slerp(frames: Floats, wxyz: Floats, at: Floats) -> Floats:
    if len(frames) == 1:
        return np.tile(wxyz / np.linalg.norm(wxyz), (len(at), 1))
    quaternions = Slerp(frames, Rotation.from_quat(wxyz, scalar_first=True))(at).as_quat(scalar_first=True)
    flips = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1]) < 0
    first = 1.0 if quaternions[0, 0] >= 0 else -1.0
    return quaternions * np.concatenate([[first], first * np.cumprod(np.where(flips, -1.0, 1.0))])[:, None]
