"""Cut, mirror, repeat and join trajectories, with seams that are invisible.

At a seam the next trajectory b is turned about the vertical and moved to the continuation of the one before, a. Their
remaining difference, in position d = a ⊖ b and in velocity v = ȧ − ḃ, is added to b and fades over the time s:

    o(u) = d (1 − 10u³ + 15u⁴ − 6u⁵) + v s (u − 6u³ + 8u⁴ − 3u⁵),     u = t/s in [0, 1],

so that position and velocity are continuous at the seam, and position, velocity and acceleration equal those of b at
its end. ⊕ and ⊖ are those of the robot's velocity space (`robot.kinematics`).
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.errors import TrajectoryError, UsageError
from robot_retarget.ramps import minimum_jerk
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.robot.timing import require_same_robot, resample
from robot_retarget.trajectory import Trajectory

SEAM = 0.4
"""Default duration of a seam [s]: that of a quick step."""


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
    return trajectory.altered(qpos=trajectory.qpos[kept], source_time=trajectory.source_time[kept])


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
    qpos = trajectory.qpos.copy()
    qpos[:, robot.qpos_index] = mirror.angles(trajectory.qpos[:, robot.qpos_index])
    if robot.floating:
        root = slice(robot.root_address, robot.root_address + 7)
        qpos[:, root] = _reflected(trajectory.qpos[:, root], np.asarray(mirror.left))
    return trajectory.altered(qpos=qpos)


def _reflected(root: Floats, left: Floats) -> Floats:
    """Return free joints (T, 7) mirrored in the vertical plane of the first heading: R ↦ M R m, m in its own axes."""
    turns = Rotation.from_quat(root[:, 3:], scalar_first=True)
    across = turns[0].apply(left) * [1, 1, 0]
    across /= np.linalg.norm(across)
    plane, own = (np.eye(3) - 2 * np.outer(normal, normal) for normal in (across, left))
    places = root[0, :3] + (root[:, :3] - root[0, :3]) @ plane
    turned = Rotation.from_matrix(plane @ turns.as_matrix() @ own)
    return np.concatenate([places, turned.as_quat(scalar_first=True)], axis=1)


def repeated(trajectory: Trajectory, robot: Robot, times: int, seam: float = SEAM) -> Trajectory:
    """Return the trajectory repeated `times` times; each repetition continues at the end of the one before.

    Raises:
        UsageError, TrajectoryError: as `joined`; `times` below one.
    """
    if times < 1:
        raise UsageError(f"a trajectory is repeated at least once, got {times}")
    return joined([trajectory] * times, robot, seam)


def joined(trajectories: Sequence[Trajectory], robot: Robot, seam: float = SEAM) -> Trajectory:
    """Return trajectories one after the other, at the rate of the first, without goals.

    Args:
        seam: duration of a seam [s]; at most the length of the trajectory after it.

    Raises:
        UsageError: nothing to join, or a seam that is not positive.
        TrajectoryError: one belongs to another robot.
    """
    if not trajectories:
        raise UsageError("nothing to join: give at least one trajectory")
    if not (np.isfinite(seam) and seam > 0):
        raise UsageError(f"a seam takes a time above 0 s, got {seam}")
    first = trajectories[0]
    require_same_robot(first, robot)
    qpos, fps = np.array(first.qpos), first.fps
    for following in trajectories[1:]:
        require_same_robot(following, robot)
        qpos = np.concatenate([qpos, _following(qpos, resample(following, robot, fps).qpos, robot, fps, seam)])
    sources = dict.fromkeys(trajectory.source for trajectory in trajectories)
    return Trajectory(qpos, fps, first.joint_names, first.robot, " + ".join(filter(None, sources)))


def _following(before: Floats, qpos: Floats, robot: Robot, fps: float, seam: float) -> Floats:
    """Return configurations (T, nq) placed at the continuation of those before, and blended into them."""
    still = np.zeros(robot.model.nv)
    pace = difference(robot, before[-2], before[-1]) if len(before) > 1 else still
    goes_on = integrate(robot, before[-1], pace)
    placed = _placed(qpos, goes_on, robot) if robot.floating else np.array(qpos)
    own = difference(robot, placed[0], placed[1]) if len(placed) > 1 else still
    away, faster = difference(robot, placed[0], goes_on), pace - own
    frames = max(min(round(seam * fps), len(placed) - 1), 1)
    u = np.clip(np.arange(len(placed)) / frames, 0, 1)[:, None]
    fading = away * (1 - minimum_jerk(u)) + faster * frames * (u - 6 * u**3 + 8 * u**4 - 3 * u**5)
    blended = np.array([integrate(robot, q, o) for q, o in zip(placed, fading, strict=True)])
    hinges = blended[:, robot.qpos_index]
    bounds = np.minimum(robot.lower, placed[:, robot.qpos_index]), np.maximum(robot.upper, placed[:, robot.qpos_index])
    blended[:, robot.qpos_index] = np.clip(hinges, *bounds)
    return blended


def _placed(qpos: Floats, start: Floats, robot: Robot) -> Floats:
    """Return configurations turned about the vertical and moved along the floor so that they start at `start`."""
    place = slice(robot.root_address, robot.root_address + 3)
    turn = slice(robot.root_address + 3, robot.root_address + 7)
    there, here = (Rotation.from_quat(q[turn], scalar_first=True) for q in (start, qpos[0]))
    yaw = Rotation.from_rotvec([0, 0, _yaw(there * here.inv())])
    placed = np.array(qpos)
    placed[:, place] = yaw.apply(qpos[:, place] - qpos[0, place]) + start[place]
    placed[:, place.start + 2] = qpos[:, place.start + 2]
    placed[:, turn] = (yaw * Rotation.from_quat(qpos[:, turn], scalar_first=True)).as_quat(scalar_first=True)
    return placed


def _yaw(turn: Rotation) -> float:
    """Return the part of a rotation about the vertical [rad]: 2 atan2(z, w)."""
    _, _, z, w = turn.as_quat()
    return 2 * float(np.arctan2(z, w))
