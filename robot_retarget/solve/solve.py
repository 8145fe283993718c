"""Solve a graph: as a whole clip, or frame by frame."""

import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.graph import Graph
from robot_retarget.progress import Count, Progress
from robot_retarget.robot.kinematics import difference
from robot_retarget.solve.causal import causal_poses
from robot_retarget.solve.clip import clip_poses, smoothness
from robot_retarget.solve.options import Options, Search, Smoothing
from robot_retarget.solve.problem import Problem, build_problem, stresses, wishes_of
from robot_retarget.solve.solution import Solution, Status
from robot_retarget.solve.sqp import FrameSolver, Pose
from robot_retarget.solve.unmet import unmet_edges
from robot_retarget.solve.windows import Part
from robot_retarget.trajectory import Trajectory

WORTH_COMPILING = 60
"""Clips of as many frames are worth the seconds that a C compiler takes, once per robot (`native.py`): others follow."""


def solve_graph(
    graph: Graph,
    *,
    problem: Problem | None = None,
    options: Options | None = None,
    search: Search | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
    part: Part | None = None,
) -> Solution:
    """The configurations that minimise the graph's edges, within its limits.

    Args:
        problem: as `problem_of` builds it, if it is there already.
        smoothing: of the whole clip; `Smoothing(passes=0)` solves frame by frame, each from the one before.
        progress: told how far it has come (`progress.Progress`).
        part: the windows of a piece of a longer clip (`long.py`); by default the graph is a whole clip.
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
        poses, graph = clip_poses(solver, graph, chosen, smoothly, count, part)
    timings = {"build": built - began, "solve": time.perf_counter() - built}
    return solution_of(solver, graph, poses, timings, anticipating=not causal)


def problem_of(graph: Graph) -> Problem:
    """The graph's edges as compiled functions."""
    return build_problem(graph.robot, graph.match, graph.tracks, native=len(graph) >= WORTH_COMPILING)


def solution_of(
    solver: FrameSolver, graph: Graph, poses: list[Pose], timings: dict[str, float], *, anticipating: bool = False
) -> Solution:
    """The poses, judged where they ended.

    Args:
        anticipating: whether interaction edges were minimised too.
    """
    qpos, problem = np.array([pose.qpos for pose in poses]), solver.problem
    motion = graph.motion
    source, times = Path(motion.source).name, motion.source_time[: len(qpos)]
    trajectory = Trajectory(
        qpos, graph.fps, graph.robot.joint_names, graph.robot.name, source,
        source_time=times, source_sha256=motion.source_sha256,
    )  # fmt: skip
    measured = measured_by(problem, graph, qpos)
    every = np.concatenate(list(measured.values()), axis=1)
    stress = {name: edges.sum(axis=1) for name, edges in stresses(graph.tracks, every).items()}
    stress["separation"] = np.array([solver.costs.separation_cost(q) for q in qpos])
    stress["coupling"] = np.array([solver.costs.coupling_cost(q) for q in qpos])
    stress["smoothness"] = _smoothness(graph, qpos)
    if anticipating:
        stress["interaction"] = _interaction(solver, qpos, graph.fps)
    wishes, unmet = wishes_of(graph.tracks), unmet_edges(solver, graph, measured, qpos)
    missed = {t for edge in unmet for t in edge.frames}
    status = tuple(Status.UNREACHED if t in missed else pose.status for t, pose in enumerate(poses))
    cost = np.array([solver.costs.cost(q, wishes.at(t)) for t, q in enumerate(qpos)])
    cost += stress["smoothness"] + stress.get("interaction", 0.0)
    iterations = np.array([pose.iterations for pose in poses])
    return Solution(trajectory, graph, status, cost, stress, measured, iterations, timings, problem.native, unmet)


def measured_by(problem: Problem, graph: Graph, qpos: Floats) -> dict[str, Floats]:
    """Per kind (T, E) what its edges measure at configurations (T, nq)."""
    every = np.array([problem.values(q) for q in qpos])
    ends = np.cumsum([len(track) for track in graph.tracks])[:-1]
    return {track.name: part for track, part in zip(graph.tracks, np.split(every, ends, axis=1), strict=True)}


def _interaction(solver: FrameSolver, qpos: Floats, fps: float) -> Floats:
    """(T,) what interaction edges cost at every frame after the first."""
    found = np.zeros(len(qpos))
    for t, (before, q) in enumerate(pairwise(qpos), start=1):
        if (edges := solver.interaction(before, fps)) is not None:
            found[t] = solver.costs.interaction_cost(q, edges)
    return found


def _smoothness(graph: Graph, qpos: Floats) -> Floats:
    """(T,) κ ‖second difference‖² about every frame; 0 at both ends."""
    robot, found = graph.robot, np.zeros(len(qpos))
    if len(qpos) > 2:
        weight, _ = smoothness(robot, graph.weights, graph.fps)
        speed = np.array([difference(robot, a, b) for a, b in pairwise(qpos)])
        found[1:-1] = (weight * np.diff(speed, axis=0) ** 2).sum(axis=1)
    return found
