"""Solve a clip: frame by frame as it comes, or as a whole."""

import time

import numpy as np

from robot_retarget.describe.edges import Edges
from robot_retarget.solve.causal import causal_pass
from robot_retarget.solve.clip import Smoothing, clip_poses
from robot_retarget.solve.footing import held_corners
from robot_retarget.solve.frame import FrameSolver, Options, Pose
from robot_retarget.solve.problem import Problem
from robot_retarget.solve.progress import Count, Progress
from robot_retarget.solve.solution import Solution
from robot_retarget.trajectory import Trajectory


def solve(
    problem: Problem,
    edges: Edges,
    fps: float,
    source: str = "",
    options: Options | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Solve the clip as a whole; with `smoothing.passes` = 0 frame by frame, each from the one before.

    Args:
        fps: frames per second of the edges.
        progress: called with (frames done, frames in all), all passes counted.
    """
    began = time.perf_counter()
    chosen, smoothly = options or Options(), smoothing or Smoothing()
    solver = FrameSolver(problem, chosen)
    # The robot itself as a source stands in the motion already; its feet may turn where a human's would be taken to stand.
    stances = edges.stances if chosen.footholds and not problem.match.itself else {}
    held = held_corners(stances, problem.feet, len(edges))
    count = Count(progress, len(edges) * max(smoothly.passes, 1))
    if smoothly.passes == 0 or len(edges) < 3:
        poses = causal_pass(solver, edges, held, fps, count)
    else:
        poses = clip_poses(solver, edges, held, smoothly, fps, count)
    return _solution(problem, edges, poses, fps, source, {"solve": time.perf_counter() - began})


def _solution(
    problem: Problem, edges: Edges, poses: list[Pose], fps: float, source: str, timings: dict[str, float]
) -> Solution:
    qpos = np.array([p.qpos for p in poses])
    errors = np.array([np.abs(problem.stress(q, edges.distance[t])[0]) for t, q in enumerate(qpos)])
    trajectory = Trajectory(qpos, fps, problem.robot.joint_names, problem.robot.name, source)
    return Solution(
        trajectory,
        tuple(p.status for p in poses),
        np.array([p.cost for p in poses]),
        errors,
        tuple(edges.labels),
        np.array([p.iterations for p in poses]),
        timings,
        problem.native,
    )
