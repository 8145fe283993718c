"""Frame by frame, the future unknown: the setting the interaction distance was made for [Mucherino2019, §5]."""

import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import frozen
from robot_retarget.base.errors import UsageError
from robot_retarget.graph.track import Objective
from robot_retarget.papers.newton import Newton
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.solution import PointSolution
from robot_retarget.papers.solvers import solve
from robot_retarget.papers.spectral import Spectral


def solve_causally(
    graph: PointGraph,
    animation: ArrayLike,
    options: Spectral | Newton | None = None,
    objective: Objective = Objective.SQUARED,
    *,
    window: int = 4,
) -> PointSolution:
    """Solve one frame after the other, each from the frames before it, which stay as they were solved.

    Frame t sees the edges of G[V × {t − window + 1 … t}]; it starts from its predecessor moved on by its last step.

    Args:
        graph: the instance over all frames.
        animation: (T, V, K) [m]; its first `window − 1` frames and fixed vertices are kept, the others not read.
        options: of the solver.
        objective: one of the smooth ones.
        window: frames looked at, 2 … T.

    Raises:
        UsageError: the window is too short or longer than the animation.
    """
    if not 2 <= window <= graph.frames:
        raise UsageError(f"window must be 2 … {graph.frames} frames, got {window}")
    x, everyone = graph.checked(animation), np.arange(len(graph.vertices))
    began, found = time.perf_counter(), []
    for frame in range(window - 1, graph.frames):
        part = graph.induced(everyone, frame - window + 1, frame)
        held = part.fixed.copy()
        held[:-1] = True
        ahead = 2.0 * x[frame - 1] - x[frame - 2] if frame > 1 else x[frame - 1]
        x[frame] = np.where(held[-1][:, None], x[frame], ahead)
        solution = solve(replace(part, fixed=held), x[frame - window + 1 : frame + 1], options, objective)
        x[frame] = solution.positions[-1]
        found.append(solution)
    return PointSolution(
        graph=graph,
        positions=frozen(x),
        objective=objective,
        statuses=tuple(solution.status for solution in found),
        iterations=tuple(solution.iterations[0] for solution in found),
        history=tuple(solution.stress for solution in found),
        seconds=time.perf_counter() - began,
        method=f"{found[0].method}, frame by frame",
    )
