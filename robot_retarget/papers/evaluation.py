"""The stress of a realization of points, its gradient, and the error of every edge.

The objectives are those of `objective`. All of them are unchanged by translation, rotation and reflection.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError
from robot_retarget.graph.track import FRAME, LEAST_DISTANCE, Objective, edge_terms
from robot_retarget.papers.edges import Edges, Incidence, incidence
from robot_retarget.papers.points import PointGraph


@dataclass(frozen=True)
class Intervals:
    """[lower, upper], π and g of the edges, (E, B) for B realizations side by side."""

    lower: Floats
    upper: Floats
    priority: Floats
    huber_delta: Floats | None = None
    """None where every edge counts squares."""

    def nearest(self, distance: Floats) -> Floats:
        """Return y, the point of the interval nearest to the distance."""
        return np.clip(distance, self.lower, self.upper)


def value_and_gradient(inc: Incidence, bounds: Intervals, objective: Objective, x: Floats) -> tuple[Floats, Floats]:
    """σ (B,) and ∂σ/∂x (N, K, B) at x (N, K, B); a coincident pair pulls nowhere.

    Args:
        inc: operator of the edges.
        bounds: their intervals and priorities.
        x: (N, K, B) [m].
    """
    r, k = inc.differences(x)
    distance = lengths(r)
    target = bounds.nearest(distance)
    share, slope, _ = edge_terms(objective, distance - target, target, bounds.priority, bounds.huber_delta)
    slope /= np.where(distance > 0, distance, np.inf)
    r *= slope[:, None]
    return share.sum(0), inc.gather(r, k)


def lengths(r: Floats) -> Floats:
    """‖r‖ over axis 1 of (E, K, B)."""
    square = r[:, 0] * r[:, 0]
    for axis in range(1, r.shape[1]):
        square += r[:, axis] * r[:, axis]
    return np.sqrt(square, out=square)


def intervals_of(edges: Edges) -> Intervals:
    """Return intervals, priorities and Huber scales as one column."""
    huber_delta = None if np.isinf(edges.huber_delta).all() else edges.huber_delta[:, None]
    return Intervals(edges.lower[:, None], edges.upper[:, None], edges.priority[:, None], huber_delta)


def operator(graph: PointGraph) -> Incidence:
    """Return the map from coordinates to the difference vector of every edge."""
    return incidence(graph.edges, graph.interaction)


def rows(x: Floats) -> Floats:
    """A realization (T, V, K) as the column (T·V, K, 1) the operators take."""
    return x.reshape(-1, x.shape[-1])[:, :, None]


def distances(graph: PointGraph, realization: ArrayLike) -> Floats:
    """d (E,) of every edge [m], Euclidean or interaction as its kind says.

    Args:
        realization: (T, V, K), or (V, K) for one frame [m].

    Raises:
        GraphError: the realization does not fit the graph.
    """
    r, _ = operator(graph).differences(rows(graph.checked(realization)))
    return lengths(r)[:, 0]


def errors(graph: PointGraph, realization: ArrayLike) -> Floats:
    """e = d − y (E,) of every edge [m]: negative where the pair is too close.

    Args:
        realization: (T, V, K), or (V, K) for one frame [m].
    """
    d = distances(graph, realization)
    return d - np.clip(d, graph.edges.lower, graph.edges.upper)


def relative_errors(graph: PointGraph, realization: ArrayLike) -> Floats:
    """|e| / max(y, floor) (E,); its mean is the MDE, its greatest value the LDE.

    Args:
        realization: (T, V, K), or (V, K) for one frame [m].
    """
    d = distances(graph, realization)
    y = np.clip(d, graph.edges.lower, graph.edges.upper)
    return np.abs(d - y) / np.maximum(y, LEAST_DISTANCE)


def stress(graph: PointGraph, realization: ArrayLike, objective: Objective = Objective.SQUARED) -> float:
    """σ(x) of the chosen objective; `SQUARED` and `HALF_SQUARED` in [m²], the relative ones without unit.

    Args:
        realization: (T, V, K), or (V, K) for one frame [m].

    Raises:
        GraphError: the realization does not fit the graph.
    """
    x = rows(graph.checked(realization))
    return float(value_and_gradient(operator(graph), intervals_of(graph.edges), objective, x)[0][0])


def gradient(graph: PointGraph, realization: ArrayLike, objective: Objective = Objective.SQUARED) -> Floats:
    """∂σ/∂x (T, V, K): for HALF_SQUARED Σ_v π (1 − δ/‖x_u − x_v‖)(x_u − x_v) at u; a subgradient for RELATIVE.

    Args:
        realization: (T, V, K), or (V, K) for one frame [m].
    """
    checked = graph.checked(realization)
    _, slope = value_and_gradient(operator(graph), intervals_of(graph.edges), objective, rows(checked))
    return slope[:, :, 0].reshape(checked.shape)


# A graph as functions of the coordinates: one column for the whole animation, or one per frame.


@dataclass(frozen=True)
class Reduced:
    """σ(X) with the interval variables eliminated: z is X, (N·K, B)."""

    inc: Incidence
    bounds: Intervals
    objective: Objective
    dimension: int

    def __call__(self, z: Floats) -> tuple[Floats, Floats]:
        x = z.reshape(-1, self.dimension, z.shape[1])
        value, slope = value_and_gradient(self.inc, self.bounds, self.objective, x)
        return value, slope.reshape(z.shape)

    def take(self, columns: NDArray[np.int64]) -> "Reduced":
        return Reduced(self.inc, taken(self.bounds, columns), self.objective, self.dimension)


def taken(bounds: Intervals, columns: NDArray[np.int64] | slice) -> Intervals:
    """Return the intervals of some realizations.

    Args:
        bounds: (E, B) or (E, 1).
        columns: which of the B realizations.
    """
    if bounds.lower.shape[1] == 1:  # shared by every column
        return bounds
    return replace(
        bounds, lower=bounds.lower[:, columns], upper=bounds.upper[:, columns], priority=bounds.priority[:, columns]
    )


def box_of(graph: PointGraph, x: Floats) -> tuple[Floats, Floats]:
    """The box of every coordinate (T, V, K), closed on the start where the vertex is fixed.

    Args:
        x: (T, V, K) coordinates [m].
    """
    held = graph.fixed[:, :, None]
    return np.where(held, x, graph.box_lower), np.where(held, x, graph.box_upper)


def by_frame(graph: PointGraph) -> tuple[PointGraph, Intervals]:
    """Return the edge pattern of one frame and its intervals (E, T), a column a frame; boxes stay with the caller.

    Frames may miss edges of the pattern: there the priority is 0.

    Raises:
        GraphError: an edge joins two frames (it is named).
    """
    for track in graph.tracks:
        if track.stencil != FRAME:
            raise GraphError(f"edge {track.edge_name(0)} joins two frames; they cannot be solved apart")
    first = graph.at_frame(0)
    pattern = replace(first, tracks=tuple(replace(track, priority=np.ones((1, len(track)))) for track in first.tracks))
    lower, upper = (np.concatenate([getattr(track, name).T for track in graph.tracks]) for name in ("lower", "upper"))
    priority = np.concatenate([(track.priority / track.scale**2).T for track in graph.tracks])
    return pattern, Intervals(lower, upper, priority, intervals_of(pattern.edges).huber_delta)
