"""Cut and mirror trajectories; ways out of a playback into a stand.

A way into a stand is a branch that comes to rest along the path of a balanced playback and ends in a stand. It is a trajectory of
its own, with the frames and the goals of the playback up to its moment, and it is judged as any trajectory.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, minimum_jerk
from robot_retarget.base.choices import Balance
from robot_retarget.base.errors import BalanceError, TrajectoryError, UsageError
from robot_retarget.edit.sequence import Part
from robot_retarget.edit.window import AROUND
from robot_retarget.human.motion import at_frames
from robot_retarget.human.robot_performer import performed
from robot_retarget.judge.compensate import compensated
from robot_retarget.judge.report import Report
from robot_retarget.judge.rollout import plant_of, simulate
from robot_retarget.robot import Robot, recognise, world_points
from robot_retarget.robot.anatomy import mirror_of
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.timing import require_same_robot, sample
from robot_retarget.scene.scene import reflected
from robot_retarget.solver.pipeline import carried
from robot_retarget.trajectory import Trajectory

# Cut and mirror trajectories.


def trimmed(trajectory: Trajectory, start: float = 0.0, stop: float | None = None) -> Trajectory:
    """Return the frames from `start` to `stop`, both inclusive, without goals [s].

    Raises:
        UsageError: no frame remains, or the times are not within the trajectory.
    """
    end = trajectory.duration if stop is None else stop
    if not 0 <= start <= end <= trajectory.duration + 1e-9:
        raise UsageError(f"{start:g} to {end:g} s is not within the trajectory's 0 to {trajectory.duration:.3g} s")
    first, last = round(start * trajectory.fps), round(end * trajectory.fps)
    kept = slice(first, last + 1)
    scene = None if trajectory.scene is None else trajectory.scene.at(kept)
    return trajectory.altered(qpos=trajectory.qpos[kept], source_time=trajectory.source_time[kept], scene=scene)


def mirrored(trajectory: Trajectory, robot: Robot) -> Trajectory:
    """Return the mirror image of a trajectory, in the vertical plane of the robot's first heading, without goals.

    Raises:
        TrajectoryError: the trajectory belongs to another robot, or the robot has a hinge without a counterpart.
        MatchError: the robot's left is unknown, because it is no humanoid.
    """
    require_same_robot(trajectory, robot)
    mirror = mirror_of(robot, np.cross([0.0, 0.0, 1.0], recognise(robot).forward))
    if not mirror.whole:
        lone = robot.joint_names[int(np.flatnonzero(mirror.partner < 0)[0])]
        raise TrajectoryError(f"{robot.name} cannot be mirrored: {lone} has no counterpart on the other side")
    qpos, left = trajectory.qpos.copy(), np.asarray(mirror.left)
    qpos[:, robot.qpos_index] = mirror.angles(trajectory.qpos[:, robot.qpos_index])
    plane = np.zeros(3), left
    if robot.floating:
        root = slice(robot.root_address, robot.root_address + 7)
        plane = _plane(trajectory.qpos[0, root], left)
        qpos[:, root] = reflected(trajectory.qpos[:, root], plane, left)
    scene = None if trajectory.scene is None else trajectory.scene.mirrored(plane)
    return trajectory.altered(qpos=qpos, scene=scene)


def _plane(root: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return a point (3,) and the normal (3,) of the vertical plane of a heading, that of a free joint (7,)."""
    across = Rotation.from_quat(np.array(root[3:]), scalar_first=True).apply(left) * [1, 1, 0]
    return root[:3], across / np.linalg.norm(across)


# Ways into a stand: at moments of a balanced playback, a branch that comes to rest along its path and ends in a stand.
#
# A branch is a separate trajectory. It has the frames and the goals of the playback up to its moment, and it is judged as any
# trajectory. A player continues to the next moment and takes the branch there.

TO_REST = 0.5
"""The motion comes to rest along its path within this time [s]: from 4 rad/s, a servo slows down by 8 rad/s²."""
HANDOVER = 0.2
"""The goals of a branch begin at most this time before a moment, at the row nearest to those of the playback [s]."""
SAME_GOALS = 0.05
"""Goals that are farther apart there were computed in another way, and the trajectory is refused [rad]."""


def ways_into_stand(
    trajectory: Trajectory, robot: Robot, every: float = 1.0, draws: int = 10
) -> Iterator[tuple[float, Report | BalanceError]]:
    """Yield the moments of a judged playback [s], each with the report of its branch, or the reason for its lack.

    Args:
        trajectory: planned with balance, with its judged goals.
        every: time between two moments [s].
        draws: as in `simulate`.

    Raises:
        TrajectoryError: the trajectory has no balance or no goals, or its goals do not compensate lag.
    """
    if not trajectory.balance or trajectory.goals is None:
        lacks = "has no goals: simulate it first" if trajectory.balance else "was not planned with balance"
        raise TrajectoryError(f"the trajectory {lacks}")
    part = Part(trajectory, performed(trajectory, robot))
    last = len(trajectory) - 1 - part.lead_out - round(TO_REST * trajectory.fps)
    for frame in range(part.lead_in, last, max(1, round(every * trajectory.fps))):
        try:
            branch = _branch(part, robot, frame)
        except BalanceError as error:
            yield frame / trajectory.fps, error
            continue
        yield frame / trajectory.fps, _judged(trajectory, branch, robot, frame, draws)


def _branch(part: Part, robot: Robot, frame: int) -> Trajectory:
    """Return the playback up to a frame, then to rest and into a stand.

    The solved branch b begins slightly off the playback a, whose centre of mass is planned further ahead. While the
    motion comes to rest, the difference fades:  b ⊕ (1 − s) (a ⊖ b),  s of minimum jerk.

    Raises:
        BalanceError: no stand can be reached from there.
    """
    trajectory, run_up = part.trajectory, min(frame, round(AROUND * part.motion.fps))
    frames = coming_to_rest(frame, run_up, trajectory.fps)
    motion = at_frames(part.motion, frames, trajectory.fps)
    result = carried(motion, robot, legs="follow", balance=cast(Balance, trajectory.balance))
    assert result.balance is not None
    timeline = result.balance.timeline
    begin = int(np.flatnonzero((timeline.share >= 1) & (timeline.at >= run_up))[0])
    at = np.interp(timeline.at[begin:], np.arange(len(frames)), frames) / trajectory.fps
    own = sample(trajectory, robot, at)
    solved = placed_by_foot(result.trajectory.qpos[begin:], own[0], robot)
    left = 1 - minimum_jerk(np.clip(np.arange(len(own)) / (TO_REST * trajectory.fps), 0, 1))
    tail = [integrate(robot, b, w * difference(robot, b, a)) for a, b, w in zip(own, solved, left, strict=True)]
    times = np.concatenate([trajectory.source_time[:frame], np.full(len(tail), trajectory.source_time[frame])])
    return trajectory.altered(qpos=np.concatenate([trajectory.qpos[:frame], tail]), source_time=times)


def coming_to_rest(frame: int, run_up: int, fps: float) -> Floats:
    """Return frames before a frame, then at a speed that falls linearly to zero."""
    u = np.arange(1, round(TO_REST * fps) + 1) / fps
    return np.concatenate([np.arange(frame - run_up, frame + 1.0), frame + (u - u**2 / (2 * TO_REST)) * fps])


def placed_by_foot(qpos: Floats, start: Floats, robot: Robot) -> Floats:
    """Return configurations moved along the floor so that the first has the lower foot of `start` in its place."""
    spots = {
        side: world_points(robot, sole, np.array([qpos[0], start])) for side, sole in recognise(robot).treads.items()
    }
    here, there = min(spots.values(), key=lambda spot: spot[1, :, 2].mean())
    flat = [spot[:, 0] + 1j * spot[:, 1] for spot in (here, there)]
    yaw = float(np.angle(np.vdot(flat[0] - flat[0].mean(), flat[1] - flat[1].mean())))
    spin, address = Rotation.from_euler("z", yaw), robot.root_address
    placed, place, turn = np.array(qpos), slice(address, address + 3), slice(address + 3, address + 7)
    placed[:, place] = (qpos[:, place] - here.mean(axis=0)) @ spin.as_matrix().T + there.mean(axis=0)
    placed[:, turn] = (spin * Rotation.from_quat(placed[:, turn], scalar_first=True)).as_quat(scalar_first=True)
    return placed


def _judged(trajectory: Trajectory, branch: Trajectory, robot: Robot, frame: int, draws: int) -> Report:
    """Return the report of a branch whose goals are those of the playback until shortly before a frame.

    Raises:
        TrajectoryError: the goals of the playback were computed otherwise.
    """
    known = trajectory.goals
    assert known is not None
    own = compensated(plant_of(robot, "free"), branch, "free")
    moment = round((known.lead_in + frame / trajectory.fps) * known.rate)
    near = slice(moment - round(HANDOVER * known.rate), moment)
    apart = np.abs(own.angles[near] - known.angles[near]).max(axis=1)
    if own.rate != known.rate or apart.min() > SAME_GOALS:
        raise TrajectoryError(
            "the goals of the trajectory are not those of `simulate` with compensation: simulate it again"
        )
    row = near.start + int(apart.argmin())
    goals = replace(own, angles=np.concatenate([known.angles[:row], own.angles[row:]]))
    return simulate(branch, robot, mode="free", goals=goals, feedback=known.feedback is not None, draws=draws)
