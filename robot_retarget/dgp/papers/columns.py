"""A graph as functions of the coordinates: one column for the whole animation, or one per frame."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_retarget.arrays import Floats
from robot_retarget.dgp.graph import Graph
from robot_retarget.dgp.incidence import Incidence
from robot_retarget.dgp.stress import Bounds, Objective, edge_terms, lengths, value_and_gradient
from robot_retarget.errors import GraphError


@dataclass(frozen=True)
class Reduced:
    """σ(X) with the interval variables eliminated: z is X, (N·K, B)."""

    inc: Incidence
    bounds: Bounds
    objective: Objective
    dimension: int

    def __call__(self, z: Floats) -> tuple[Floats, Floats]:
        x = z.reshape(-1, self.dimension, z.shape[1])
        value, slope = value_and_gradient(self.inc, self.bounds, self.objective, x)
        return value, slope.reshape(z.shape)

    def take(self, columns: NDArray[np.int64]) -> "Reduced":
        return Reduced(self.inc, taken(self.bounds, columns), self.objective, self.dimension)


@dataclass(frozen=True)
class Explicit:
    """σ(X, y) = Σ share(d − y) with a variable y within [lower, upper] per edge: z stacks X and y, (N·K + E, B)."""

    inc: Incidence
    bounds: Bounds
    objective: Objective
    dimension: int

    def __call__(self, z: Floats) -> tuple[Floats, Floats]:
        edges = len(self.bounds.lower)
        x = z[:-edges].reshape(-1, self.dimension, z.shape[1])
        r, k = self.inc.differences(x)
        distance, y = lengths(r), z[-edges:]
        share, slope, _ = edge_terms(self.objective, distance - y, y, self.bounds.priority, self.bounds.huber_delta)
        r *= (slope / np.where(distance > 0, distance, np.inf))[:, None]
        pull = self.inc.gather(r, k).reshape(len(z) - edges, -1)
        return share.sum(0), np.concatenate([pull, -slope])

    def take(self, columns: NDArray[np.int64]) -> "Explicit":
        return Explicit(self.inc, taken(self.bounds, columns), self.objective, self.dimension)


@dataclass(frozen=True)
class Lifted:
    """σ(X) in more dimensions than K, plus `weight` times the squared coordinates beyond the first K.

    Two points that must pass through each other in K dimensions can pass around each other in K + 2.
    """

    stress: Reduced
    """Stress over the lifted points."""
    kept: int
    """K."""
    weight: float

    def __call__(self, z: Floats) -> tuple[Floats, Floats]:
        value, slope = self.stress(z)
        out = z.reshape(-1, self.stress.dimension, z.shape[1])[:, self.kept :]
        slope = slope.reshape(-1, self.stress.dimension, z.shape[1])
        slope[:, self.kept :] += 2.0 * self.weight * out
        return value + self.weight * (out**2).sum((0, 1)), slope.reshape(z.shape)

    def take(self, columns: NDArray[np.int64]) -> "Lifted":
        return Lifted(self.stress.take(columns), self.kept, self.weight)


def taken(bounds: Bounds, columns: NDArray[np.int64] | slice) -> Bounds:
    """The bounds of some realizations."""
    if bounds.lower.shape[1] == 1:  # shared by every column
        return bounds
    huber_delta = None if bounds.huber_delta is None else bounds.huber_delta[:, columns]
    return Bounds(bounds.lower[:, columns], bounds.upper[:, columns], bounds.priority[:, columns], huber_delta)


def box_of(graph: Graph, x: Floats) -> tuple[Floats, Floats]:
    """The box of every coordinate (T, V, K), closed on the start where the vertex is fixed."""
    held = graph.fixed[:, :, None]
    return np.where(held, x, graph.box_lower), np.where(held, x, graph.box_upper)


def by_frame(graph: Graph) -> tuple[Graph, Bounds]:
    """The edge pattern of one frame and its bounds (E, T), a column a frame.

    Frames may miss edges of the pattern: there the priority is 0. Boxes stay with the caller.

    Raises:
        GraphError: an edge joins two frames (it is named), or there are two edges of one kind between one pair.
    """
    size = len(graph.vertices)
    (frame, a), (other, b) = np.divmod(graph.i, size), np.divmod(graph.j, size)
    if (frame != other).any():
        edge = int(np.flatnonzero(frame != other)[0])
        raise GraphError(f"edge {edge} ({graph.edge_name(edge)}) joins two frames; they cannot be solved apart")
    keys = np.stack([np.minimum(a, b), np.maximum(a, b), graph.kind], axis=1)
    pattern, row = np.unique(keys, axis=0, return_inverse=True)
    row = row.ravel()
    _refuse_doubles(graph, row, frame)
    columns = {"lower": 0.0, "upper": np.inf, "priority": 0.0}
    columns |= {} if np.isinf(graph.huber_delta).all() else {"huber_delta": np.inf}
    tables = {name: np.full((len(pattern), graph.frames), absent) for name, absent in columns.items()}
    for name, table in tables.items():
        table[row, frame] = getattr(graph, name)
    single = replace(
        graph.induced(np.arange(size), 0, 0),
        i=pattern[:, 0],
        j=pattern[:, 1],
        kind=pattern[:, 2],
        lower=0.0,
        upper=np.inf,
        priority=1.0,
        huber_delta=np.inf,
    )
    return single, Bounds(**tables)


def _refuse_doubles(graph: Graph, row: NDArray[np.int64], frame: NDArray[np.int64]) -> None:
    place = row * graph.frames + frame
    order = np.argsort(place, kind="stable")
    twice = np.flatnonzero(np.diff(place[order]) == 0)
    if twice.size:
        edge = int(order[twice[0] + 1])
        raise GraphError(f"edge {edge} ({graph.edge_name(edge)}) repeats another of its kind; give it another kind")


def blocks(count: int, size: int) -> Iterator[slice]:
    """Slices of at most `size` that cover `range(count)`."""
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))
