"""One interface to the solvers: the input is a graph and a start, the result is a `Solution`."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import UsageError
from robot_retarget.graph.track import Objective, Status
from robot_retarget.papers.evaluation import (
    Reduced,
    box_of,
    by_frame,
    errors,
    intervals_of,
    operator,
    relative_errors,
    stress,
    taken,
)
from robot_retarget.papers.ipopt import Ipopt, constrain
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.spectral import Minimum, Spectral, minimise

# The result of a solver of points: the realization, the reason that it stopped, and measures of its quality.


@dataclass(frozen=True, eq=False)
class PointSolution:
    """A realization of a graph of points, and how it was found."""

    graph: PointGraph
    positions: Floats
    """(T, V, K) [m]."""
    objective: Objective
    statuses: tuple[Status, ...]
    """One, or one per frame where the frames were solved apart."""
    iterations: tuple[int, ...]
    """As `statuses`."""
    history: tuple[float, ...]
    """σ after each iteration; the sum where the frames were solved apart."""
    seconds: float
    """Wall time [s]."""
    method: str

    @property
    def status(self) -> Status:
        """The worst of the statuses."""
        return max(self.statuses, key=list(Status).index)

    @property
    def converged(self) -> bool:
        """Whether every frame ended at a stationary point."""
        return self.status is Status.CONVERGED

    @cached_property
    def stress(self) -> float:
        """σ of the objective that was minimised."""
        return stress(self.graph, self.positions, self.objective)

    @cached_property
    def errors(self) -> Floats:
        """(E,) signed error of every edge [m]."""
        return errors(self.graph, self.positions)

    @cached_property
    def relative_errors(self) -> Floats:
        """(E,) relative error of every edge."""
        return relative_errors(self.graph, self.positions)

    @property
    def largest_error(self) -> float:
        """LDE, the largest relative error over the edges."""
        return float(self.relative_errors.max(initial=0.0))


_BATCH = 128
"""Frames solved side by side: their edges stay in the processor's cache."""


def solve(
    graph: PointGraph,
    start: ArrayLike,
    options: Spectral | Ipopt | None = None,
    objective: Objective = Objective.SQUARED,
) -> PointSolution:
    """Find x: V × T → ℝ^K with a (locally) least stress, all frames at once.

    Args:
        graph: the instance; edges are soft (but see `Ipopt`), boxes and fixed vertices are hard.
        start: (T, V, K), or (V, K) for one frame [m]. A solution of a neighbouring problem is a warm start.
        options: which method, and its parameters: `Spectral` (the papers', the default) or `Ipopt` (second order, hard bones
            and thresholds; `Ipopt(())` leaves every edge soft).
        objective: any of the four; `RELATIVE` has kinks and is for `Ipopt` alone. The stress of a solution counts the
            hard edges too, with what error they have.

    Raises:
        GraphError: the start does not fit the graph.
        UsageError: the objective is not smooth and the method needs it so.
    """
    options = options or Spectral()
    x = graph.checked(start) if isinstance(options, Ipopt) else _ready(graph, start, objective)
    began = time.perf_counter()
    if isinstance(options, Ipopt):
        return _solution(graph, [constrain(graph, x, options, objective)], objective, began, "ipopt")
    lower, upper = (side.reshape(-1, 1) for side in box_of(graph, x))
    found = minimise(_reduced(graph, objective), x.reshape(-1, 1), lower, upper, options)
    return _solution(graph, [found], objective, began, "spectral")


def solve_frames(
    graph: PointGraph, start: ArrayLike, options: Spectral | None = None, objective: Objective = Objective.SQUARED
) -> PointSolution:
    """The same for a graph whose edges stay within a frame: T independent problems, solved side by side.

    Args:
        start: (T, V, K) [m].

    Raises:
        GraphError: an edge joins two frames, or is measured across two.
    """
    x, options = _ready(graph, start, objective), options or Spectral()
    began = time.perf_counter()
    pattern, bounds = by_frame(graph)
    inc, found = operator(pattern), []
    z, lower, upper = (side.reshape(graph.frames, -1).T for side in (x, *box_of(graph, x)))
    for first in range(0, graph.frames, _BATCH):
        block = slice(first, first + _BATCH)
        part = Reduced(inc, taken(bounds, block), objective, graph.dimension)
        found.append(minimise(part, z[:, block], lower[:, block], upper[:, block], options))
    return _solution(graph, found, objective, began, "spectral")


def multistart(
    graph: PointGraph,
    starts: Sequence[ArrayLike],
    options: Spectral | None = None,
    objective: Objective = Objective.SQUARED,
) -> PointSolution:
    """The solution of least stress over several starts, searched side by side.

    Args:
        starts: (T, V, K) each [m].

    Raises:
        UsageError: there is no start.
    """
    if not len(starts):
        raise UsageError("multistart needs at least one start")
    xs, options = [_ready(graph, start, objective) for start in starts], options or Spectral()
    began = time.perf_counter()
    boxes = [box_of(graph, x) for x in xs]
    lower, upper = (np.stack([sides[side].ravel() for sides in boxes], axis=1) for side in range(2))
    z = np.stack([x.ravel() for x in xs], axis=1)
    found = minimise(_reduced(graph, objective), z, lower, upper, options)
    best = int(np.argmin(found.values))
    chosen = Minimum(
        found.z[:, [best]], found.values[[best]], (found.statuses[best],), (found.iterations[best],), found.history
    )
    return _solution(graph, [chosen], objective, began, "spectral")


def _reduced(graph: PointGraph, objective: Objective) -> Reduced:
    return Reduced(operator(graph), intervals_of(graph.edges), objective, graph.dimension)


def _ready(graph: PointGraph, start: ArrayLike, objective: Objective) -> Floats:
    if objective is Objective.RELATIVE:
        raise UsageError("the relative objective has kinks: use RELATIVE_SQUARED, or Ipopt, which takes it")
    return graph.checked(start)


def _solution(
    graph: PointGraph, found: list[Minimum], objective: Objective, began: float, method: str
) -> PointSolution:
    shape = (graph.frames, len(graph.vertices), graph.dimension)
    coordinates = shape[0] * shape[1] * shape[2] // sum(part.z.shape[1] for part in found)
    positions = np.concatenate([part.z[:coordinates].T for part in found]).reshape(shape)
    longest = max(len(part.history) for part in found)
    padded = np.array([part.history + part.history[-1:] * (longest - len(part.history)) for part in found])
    return PointSolution(
        graph=graph,
        positions=frozen(positions),
        objective=objective,
        statuses=tuple(status for part in found for status in part.statuses),
        iterations=tuple(count for part in found for count in part.iterations),
        history=tuple(float(value) for value in padded.sum(axis=0)),
        seconds=time.perf_counter() - began,
        method=method,
    )


# Frame by frame, the future unknown: the setting the interaction distance was made for [Mucherino2019, §5].


def solve_causally(
    graph: PointGraph,
    animation: ArrayLike,
    options: Spectral | Ipopt | None = None,
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
