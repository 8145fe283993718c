"""Ways from and into the robot's stand at both ends of any trajectory, without dynamics.

With d the tangent from the stand to the first frame, v the velocity there and T the time, u = t / T, a way is

    stand ⊕ [(10 d − 4 v T) u³ + (7 v T − 15 d) u⁴ + (6 d − 3 v T) u⁵],

the polynomial of minimum jerk that begins at rest and ends at d with v and no acceleration; the way out is its reverse. Along the
floor d is at least v T / 2, with which no velocity turns back, and T is the time in which friction alone reaches v.
"""

import numpy as np
from scipy.constants import g

from robot_retarget.base.arrays import Floats, least_jerk
from robot_retarget.base.errors import UsageError
from robot_retarget.edit.cuts import placed_by_foot
from robot_retarget.edit.held import fixed, held, with_root
from robot_retarget.edit.window import FIXED
from robot_retarget.graph.describe import describe
from robot_retarget.human.robot_performer import performed
from robot_retarget.judge.worlds import Spread
from robot_retarget.robot import Robot, recognise, world_points
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.dynamics import root_travel
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.solve import problem_of, solve_graph
from robot_retarget.trajectory import Trajectory

LENGTHEN = 1.1
"""Factor by which a way lasts longer until no joint is faster than it may be [-]: the least duration is met within 10 % ..."""
LONGEST_WAY = 10.0
"""... or until this time [s]: a joint that is too fast in the trajectory is too fast at the end of its way, too."""
STEEPEST = 1.5
"""Largest slope of a smoothstep, with which the root comes to its speed [-]."""
HASTE = Spread().friction[0] * g
"""Largest acceleration of the root along the floor, that of the most slippery floor of drawn worlds [m/s²]."""


def between_stands(trajectory: Trajectory, robot: Robot, seconds: float = 1.0) -> Trajectory:
    """Return a trajectory that begins and ends in the robot's standing pose, without goals.

    The stand has its lower foot where the trajectory has it, or further back where the root comes to its speed on the way. The
    height of the lowest point of the soles changes linearly. Links that would be inside each other are kept apart.

    Args:
        seconds: T [s]; a way lasts longer where a joint would be too fast, or the root would have to slip. 0 returns the
            trajectory.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        UsageError: the time is negative or not finite.
    """
    require_same_robot(trajectory, robot)
    if not 0 <= seconds < np.inf:
        raise UsageError(f"a way from a stand lasts 0 s or more, got {seconds:g}")
    if seconds == 0:
        return trajectory
    before = _way_from_stand(trajectory.qpos, robot, trajectory.fps, seconds)
    after = _way_from_stand(trajectory.qpos[::-1], robot, trajectory.fps, seconds)[::-1]
    kept = np.clip(np.arange(-len(before), len(trajectory) + len(after)), 0, len(trajectory) - 1)
    scene = None if trajectory.scene is None else trajectory.scene.at(kept)
    qpos, times = np.concatenate([before, trajectory.qpos, after]), trajectory.source_time[kept]
    return trajectory.altered(qpos=qpos, source_time=times, scene=scene, likeness=trajectory.likeness)


def _way_from_stand(path: Floats, robot: Robot, fps: float, seconds: float) -> Floats:
    """Return the configurations (N, nq) that lead from the stand to the first of a path (T, nq), without that one."""
    stand = _stand(path[0], robot)
    while True:
        way, risen = _smooth_way(stand, path, robot, fps, seconds)
        angles = np.concatenate([way, path[:1]])[:, robot.qpos_index]
        if seconds >= LONGEST_WAY or (np.abs(np.diff(angles, axis=0)) * fps <= robot.max_speed + 1e-9).all():
            break
        seconds *= LENGTHEN
    way[:, robot.qpos_index] = np.clip(angles[:-1], robot.lower, robot.upper)
    if not (robot.floating and recognise(robot).treads):
        return way
    joined = np.concatenate([way, path[:FIXED]])
    joined[: len(way), robot.root_address + 2] -= _hovering(joined[: len(way) + 1], risen, robot)
    return _apart(joined, robot, fps)[: len(way)]


def _stand(first: Floats, robot: Robot) -> Floats:
    """Return the standing pose (nq,), with its lower foot where a configuration has it."""
    stand = np.array(first)
    stand[robot.qpos_index] = np.clip(robot.standing()[robot.qpos_index], robot.lower, robot.upper)
    if not (robot.floating and recognise(robot).treads):
        return stand
    stand[: robot.qpos_index[0]] = robot.standing()[: robot.qpos_index[0]]
    return placed_by_foot(stand[None], first, robot)[0]


def _smooth_way(stand: Floats, path: Floats, robot: Robot, fps: float, seconds: float) -> tuple[Floats, Floats]:
    """Return the configurations (N, nq) of the polynomial, and the share (N,) of the time of joints that is over."""
    change, velocity = difference(robot, stand, path[0]), difference(robot, path[0], path[min(1, len(path) - 1)]) * fps
    floor = root_travel(robot)[:2] if robot.floating else np.zeros(0, dtype=int)
    speed = float(np.linalg.norm(velocity[floor]))
    lasts = np.full(len(change), seconds)
    lasts[floor] = max(seconds, STEEPEST * speed / HASTE)
    lasts = np.maximum(1, np.round(lasts * fps)) / fps
    ahead, count, shift = velocity[floor] / max(speed, 1e-9), round(lasts.max() * fps), velocity * lasts
    back = max(0.0, speed * lasts.max() / 2 - float(change[floor] @ ahead)) * ahead
    start = stand.copy()
    start[robot.root_address : robot.root_address + len(floor)] -= back
    change[floor] += back
    u = np.maximum(0.0, 1 - (count - np.arange(count))[:, None] / fps / lasts)
    way, _ = least_jerk(u, change, np.zeros_like(shift), shift)
    return integrate(robot, np.tile(start, (count, 1)), way), u[:, robot.dof_index[0]]


def _hovering(joined: Floats, risen: Floats, robot: Robot) -> Floats:
    """Return how much too high (N,) the lowest point of the soles is on a way and the frame after it (N + 1, nq) [m]."""
    soles = [world_points(robot, tread, joined)[:, :, 2] for tread in recognise(robot).treads.values()]
    lowest = np.concatenate(soles, axis=1).min(axis=1)
    return lowest[:-1] - (lowest[0] + risen * (lowest[-1] - lowest[0]))


def _apart(joined: Floats, robot: Robot, fps: float) -> Floats:
    """Return a way and the frames after it with links apart, by the nearest poses of the solver; its ends stay unchanged."""
    allowed = SolveOptions().overlap
    if all((depth <= allowed).all() for depth, _ in Separation(robot, allowed).overlaps_along(joined)):
        return joined
    trajectory = Trajectory(joined, fps, robot.joint_names, robot.name)
    graph = with_root(describe(performed(trajectory, robot), robot, fps=fps).without("foothold"))
    problem, ends = problem_of(graph), np.ones(len(joined), dtype=bool)
    ends[FIXED:-FIXED] = False
    graph = held(graph, problem, joined, np.ones(len(robot.joint_names), dtype=bool))
    graph = fixed(graph, joined, np.tile(ends[:, None], len(robot.joint_names)), np.ones(len(joined), dtype=bool))
    found = solve_graph(graph, problem=problem, start=joined).trajectory.qpos
    return np.where(ends[:, None], joined, found)
