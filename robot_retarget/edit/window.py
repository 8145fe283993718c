"""The window of a touch-up: the frames of an edge and those around it, solved as a clip from a smooth way there and back.

The window is the frames of the edge and the time before and after that the joints need to come and go (`AROUND` at least).
The frames of the edge are solved alone first, and the frames around lead there and back smoothly. All frames outside stay.
"""

import math

import numpy as np

from robot_retarget.base.arrays import SMOOTHSTEP_PEAK, Bools, Floats, smoothstep
from robot_retarget.edit.held import fixed
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import Targets, targets_of
from robot_retarget.solver.options import Search
from robot_retarget.solver.solution import UNMET, Solution
from robot_retarget.solver.solve import solve_graph
from robot_retarget.solver.sqp import FrameSolver

AROUND = 0.5
"""Least time before and after an edge, or before a branch, that is solved with it [s]: stances need it. Where a hand of
a wave is set to 0.2 m from the head for a third of a second, half changes nothing and double lowers the jerk from 104
to 86 rad/s³, at 14 more frames."""
FIXED = 2
"""Frames that stay at each end of a window, or of a way to a stand: 2 hold position and velocity."""
MISSED = 10 * UNMET
"""A pose that misses a hard edge by more is sought from other starts, and the report of the edge says why [m]."""


def solved_window(
    solver: FrameSolver, graph: RobotGraph, known: Floats, first: int, last: int
) -> tuple[Solution, int, Bools]:
    """Solve the frames around those of an edge again.

    Args:
        graph: of all frames, with the edge.
        known: (T, nq) the trajectory.
        first: frame of the edge.
        last: frame of the edge.

    Returns:
        The solution of the window, its first frame, and which of its frames may have moved.
    """
    every = targets_of(graph.tracks)
    changes = _changes(solver, every, known, first, last)
    around = max(round(AROUND * graph.fps), _frames_needed(solver, every, changes, graph.fps))
    start, stop = max(first - around - FIXED, 0), min(last + 1 + around + FIXED, len(graph))
    frames, own = np.arange(start, stop), known[start:stop]
    away = np.maximum(np.maximum(first - frames, frames - last), 0)
    share, stays = smoothstep(np.clip(1 - away / around, 0, 1))[:, None], away > around
    begin = integrate(graph.robot, own, share * changes[np.clip(frames, first, last) - first])
    window = fixed(graph.frames(start, stop), own, np.tile(stays[:, None], len(solver.hinges)), stays)
    return solve_graph(window, problem=solver.problem, start=begin), start, ~stays


def _changes(solver: FrameSolver, every: Targets, known: Floats, first: int, last: int) -> Floats:
    """Per frame of the edge (F, nv) the change that solves it alone, from the change of the frame before."""
    changes = [difference(solver.robot, known[first], _pose(solver, known[first], every.at(first)).qpos)]
    for t in range(first + 1, last + 1):
        pose = solver.solve_frame(integrate(solver.robot, known[t], changes[-1]), every.at(t))
        changes.append(difference(solver.robot, known[t], pose.qpos))
    return np.array(changes)


def _pose(solver: FrameSolver, own: Floats, targets: Targets) -> FrameSolution:
    """Return the pose of a frame, from its own one (nq,); where that misses a hard edge, the cheapest from drawn ones, too."""
    pose, search, hinges = solver.solve_frame(own, targets), Search(), solver.robot.qpos_index
    if solver.problem.missed(pose.qpos, targets) <= MISSED:
        return pose
    box = solver.ranges(targets)
    drawn = np.tile(own, (search.drawn, 1))
    drawn[:, hinges] = np.random.default_rng(0).uniform(box.lower, box.upper, (search.drawn, len(hinges)))
    alike = targets.at(None).at(np.zeros(search.drawn, dtype=int))
    best = np.argsort(solver.problem.cost(drawn, alike), kind="stable")[: search.starts]
    starts = np.array([solver.clear_of_links(own, q) for q in drawn[best]])
    return min([pose, *solver.solve_frames(starts, alike.at(best))], key=lambda found: found.cost)


def _frames_needed(solver: FrameSolver, every: Targets, changes: Floats, fps: float) -> int:
    """Frames in which joints at their speed cover the largest change on a smooth way."""
    speed = solver.problem.limits.bounds(every).speed.min(axis=0)
    way = np.abs(changes[[0, -1]][:, solver.hinges])
    return math.ceil(float((SMOOTHSTEP_PEAK * way / speed).max(initial=0.0)) * fps)
