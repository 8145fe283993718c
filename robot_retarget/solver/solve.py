"""Solve a graph as a whole clip or frame by frame, and a long clip piece by piece."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MatchError
from robot_retarget.base.progress import Count, Progress
from robot_retarget.graph.describe import DescribeArguments, RobotGraph, graph_of, matched_among
from robot_retarget.graph.placed_scene import placed_scene
from robot_retarget.graph.track import Status
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.robot.model import assumed_speed_notes
from robot_retarget.scores.likeness import likeness_of
from robot_retarget.scores.plausibility import mismatch
from robot_retarget.solver.clip import clip_poses, measured_by, stresses
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.options import ClipPiece, FrameWindow, Search, Smoothing, SolveOptions
from robot_retarget.solver.problem import Problem, build_problem
from robot_retarget.solver.solution import Solution, unmet_edges
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import causal_poses
from robot_retarget.trajectory import Trajectory

WORTH_COMPILING = 60
"""Number of frames from which a clip is worth the compile time of a C compiler, once per robot (`native.py`), for later
clips."""


def solve_graph(
    graph: RobotGraph,
    *,
    problem: Problem | None = None,
    options: SolveOptions | None = None,
    search: Search | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
    part: ClipPiece | None = None,
    start: Floats | None = None,
) -> Solution:
    """Return the configurations that minimise the graph's edges within its limits.

    Args:
        problem: the result of `problem_of`, if it exists already.
        smoothing: options of the whole clip; `Smoothing(passes=0)` solves frame by frame, each from the one before.
        progress: receives the progress (`progress.Progress`).
        part: the windows of a piece of a longer clip (`solve_long`); by default the graph is a whole clip.
        start: (T, nq) configurations that the passes start from; by default those of the search.
    """
    began = time.perf_counter()
    chosen, smoothly = search or Search(), smoothing or Smoothing()
    problem = problem or problem_of(graph)
    solver, built = FrameSolver(problem, options), time.perf_counter()
    count = Count(progress, len(graph))
    causal = smoothly.passes == 0 or len(graph) < 3
    if causal:
        poses = causal_poses(solver, graph, chosen, count)
    else:
        poses, graph = clip_poses(solver, graph, chosen, smoothly, count, part, start)
    timings = {"build": built - began, "solve": time.perf_counter() - built}
    return solution_of(solver, graph, poses, timings)


def trajectory_of(motion: Motion, robot: Robot, qpos: Floats) -> Trajectory:
    """Return configurations as a trajectory that names its source and times.

    Args:
        motion: its first T frames are the source.
        qpos: (T, nq) configurations.
    """
    return Trajectory(
        qpos,
        motion.fps,
        robot.joint_names,
        robot.name,
        Path(motion.source).name,
        source_time=motion.source_time[: len(qpos)],
        source_sha256=motion.source_sha256,
    )


def problem_of(graph: RobotGraph) -> Problem:
    """Compile the graph's edges as functions."""
    return build_problem(graph.robot, graph.match, graph.tracks, native=len(graph) >= WORTH_COMPILING)


def solution_of(
    solver: FrameSolver, graph: RobotGraph, poses: list[FrameSolution], timings: dict[str, float]
) -> Solution:
    """Evaluate the cost of every frame and the stress of every kind at solved poses.

    Args:
        solver: the solver of the poses.
        graph: its T frames.
        poses: T solved frames.
        timings: durations of the stages [s].
    """
    qpos, problem = np.array([pose.qpos for pose in poses]), solver.problem
    trajectory = replace(trajectory_of(graph.motion, graph.robot, qpos), scene=graph.bodies)
    measured, stress = measured_by(problem, graph, qpos), stresses(solver, graph, qpos)
    unmet = unmet_edges(solver, graph, measured, qpos)
    missed = {t for edge in unmet for t in edge.frames}
    status = tuple(Status.UNREACHED if t in missed else pose.status for t, pose in enumerate(poses))
    cost = np.sum(list(stress.values()), axis=0)
    iterations = np.array([pose.iterations for pose in poses])
    return Solution(trajectory, graph, status, cost, stress, measured, iterations, timings, problem.native, unmet)


# A clip of any length, solved piece by piece: memory is that of one piece, time grows with the number of frames.
#
# Windows are those of the whole clip (`Windows.cut`). A piece describes and solves a few of them. It passes the
# configurations that the next window keeps to the next piece, so pieces join as windows do.

PIECE = 6
"""Number of windows of a piece."""


def solve_long(
    motion: Motion, robot: Robot, *, smoothing: Smoothing | None = None, **how: Unpack[DescribeArguments]
) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the trajectory of `retarget` without balance, and its notes, in the memory of one piece.

    Either piece places the footholds of a stance that spans two pieces. There the result may differ from `retarget` by
    as much as a foothold may.

    Args:
        motion: the human's.
        robot: the robot.
        smoothing: as in `solve`.
        how: as `DescribeArguments` states.

    Raises:
        MatchError, SceneError, UsageError: as `retarget`.
    """
    motion, matched, robot, weights = matched_among(motion, robot, **how)
    human, smoothly = features_of(motion, matched), smoothing or Smoothing()
    qpos, done, status = np.empty((len(motion), robot.model.nq)), 0, list[Status]()
    for own in _pieces(tuple(smoothly.windows.cut(len(motion), motion.fps))):
        first, last, fixed = own[0].first, own[-1].last, own[0].fixed
        piece = human.at(slice(first, last))
        led = replace(robot, begun=robot.begun + first / motion.fps) if robot.led else robot
        graph = graph_of(motion.frames(first, last), piece, led, weights).unbalanced()
        origin = _origin(human, first)
        known = _moved(qpos[done - fixed : done], robot, -origin)
        part = ClipPiece(tuple(window.after(first) for window in own), tuple(known))
        solved = solve_graph(graph, smoothing=smoothly, part=part)
        qpos[done : own[-1].final] = _moved(solved.trajectory.qpos, robot, origin)
        status += solved.status
        done = own[-1].final
    if how.get("overrides") is None and (doubt := mismatch(human, robot, qpos, motion.source)):
        raise MatchError(doubt)
    likeness, placed = likeness_of(human, robot, qpos, unfinished=unfinished(status)), placed_scene(human, matched)
    trajectory = replace(trajectory_of(motion, robot, qpos), scene=placed and placed.scene, likeness=likeness.figures())
    speeds = assumed_speed_notes(robot, trajectory.angles, trajectory.fps)
    return trajectory, (*motion.notes, *matched.notes, *likeness.notes, *speeds)


def unfinished(status: Sequence[Status]) -> float:
    """Return the share of frames that the solver left before convergence."""
    return sum(one in (Status.OUT_OF_ITERATIONS, Status.BLOCKED) for one in status) / len(status)


def _pieces(windows: tuple[FrameWindow, ...]) -> Iterator[tuple[FrameWindow, ...]]:
    for first in range(0, len(windows), PIECE):
        yield windows[first : first + PIECE]


def _origin(human: HumanFeatures, first: int) -> Floats:
    """Return (2,) the start of a piece's path on the clip's path [m]; each path starts above its own origin."""
    match = human.calibration.match
    column = match.index("pelvis") if "pelvis" in match.keypoints else slice(None)
    start, begun = (human.positions[t, column].reshape(-1, 3).mean(axis=0) for t in (0, first))
    return (begun - start)[:2] * match.leg_ratio


def _moved(qpos: Floats, robot: Robot, way: Floats) -> Floats:
    """Return configurations (T, nq) moved along the floor by (2,) [m]; a robot with a fixed root stays."""
    moved = qpos.copy()
    if robot.floating:
        moved[:, robot.root_address : robot.root_address + 2] += way
    return moved
