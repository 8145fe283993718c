"""Solve a graph as a whole clip."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.progress import Count, Progress
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import Status
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.solver.clip import clip_poses, measured_by, solved_tracks, stresses
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.one_thread import ONE_THREAD
from robot_retarget.solver.options import Search, Smoothing, SolveOptions
from robot_retarget.solver.problem import Problem, build_problem
from robot_retarget.solver.solution import Solution, unmet_edges
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.trajectory import Trajectory

WORTH_COMPILING = 60
"""Number of frames from which a clip is worth the compile time of a C compiler, once per robot (`native.py`), for later
clips: that of the G1 is 5 s of a core, and 66 frames of a dance are solved in 1.8 s."""


@ONE_THREAD
def solve_graph(
    graph: RobotGraph,
    *,
    problem: Problem | None = None,
    options: SolveOptions | None = None,
    search: Search | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
    start: Floats | None = None,
) -> Solution:
    """Return the configurations that minimise the graph's edges within its limits.

    Args:
        problem: the result of `problem_of`, if it exists already.
        smoothing: options of the whole clip.
        progress: receives the progress (`progress.Progress`).
        start: (T, nq) configurations that the steps start from; by default those of the search.
    """
    began = time.perf_counter()
    problem = problem or problem_of(graph)
    solver, built = FrameSolver(problem, options), time.perf_counter()
    count = Count(progress, len(graph))
    poses, solved = clip_poses(solver, graph, search or Search(), smoothing or Smoothing(), count, start)
    timings = {"build": built - began, "solve": time.perf_counter() - built}
    return solution_of(solver, solved, poses, timings, graph)


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
    solver: FrameSolver,
    graph: RobotGraph,
    poses: list[FrameSolution],
    timings: dict[str, float],
    planned: RobotGraph | None = None,
) -> Solution:
    """Evaluate the cost of every frame and the stress of every kind at solved poses.

    Args:
        solver: the solver of the poses.
        graph: its T frames.
        poses: T solved frames.
        timings: durations of the stages [s].
        planned: the graph before feet were freed; a freed foot is reported at the place where it would stand.
    """
    qpos, problem = np.array([pose.qpos for pose in poses]), solver.problem
    work = {name: count / len(poses) for name, count in solver.costs.work.items()}
    trajectory = replace(trajectory_of(graph.motion, graph.robot, qpos), scene=graph.bodies)
    measured, stress = measured_by(problem, graph, qpos), stresses(solver, graph, qpos)
    unmet = unmet_edges(solver, graph, measured, qpos, solved_tracks(solver, planned, qpos) if planned else ())
    missed = {t for edge in unmet for t in edge.frames}
    status = tuple(Status.UNREACHED if t in missed else pose.status for t, pose in enumerate(poses))
    cost = np.sum(list(stress.values()), axis=0)
    iterations = np.array([pose.iterations for pose in poses])
    return Solution(trajectory, graph, status, cost, stress, measured, iterations, timings, work, problem.native, unmet)
