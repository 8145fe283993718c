"""Instances of the papers: sensor networks, a stiff mesh, smoothness, starts and choices of realizations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.graph.track import Objective
from robot_retarget.papers.branch import Realizations
from robot_retarget.papers.build import edge_track, empty, frame_edges
from robot_retarget.papers.edges import SMOOTHNESS
from robot_retarget.papers.evaluation import Reduced, intervals_of, operator
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.spectral import Spectral, minimise


def sensor_network(count: int, seed: int, *, reach: float = 0.18, width: float = 0.1) -> PointGraph:
    """A sparse network in the style of the public sensor instances, without its solution.

    Points in a box of 0.9 m: each measures its two predecessors exactly and the third, as well as every point nearer
    than `reach`, to within `width` [m]. About four distances per sensor, hardly more than rigidity needs.

    Args:
        count: number of sensors.
        seed: of the random numbers.
        reach: pairs nearer than this are measured [m].
        width: width of an interval [m].
    """
    rng = np.random.default_rng(seed)
    graph = frame_edges(tuple(f"s{sensor}" for sensor in range(count)), 0.9 * rng.uniform(0, 1, (count, 3)))
    edges = graph.edges
    graph = graph.select((edges.j - edges.i <= 3) | (edges.lower < reach))
    edges, draw = graph.edges, rng.random(len(graph.edges))
    wide = edges.j - edges.i >= 3
    lower = np.where(wide, np.maximum(edges.lower - width * draw, 0.0), edges.lower)
    return graph.with_targets(lower=lower, upper=lower + width * wide)


def stiff_mesh(seed: int, error: float = 0.02) -> tuple[PointGraph, PointGraph]:
    """A closed mesh of triangles (an uneven octahedron of 0.1–0.14 m) whose three diagonals are measured with errors.

    Args:
        seed: of the random numbers.
        error: largest relative error of a measured diagonal [-].

    Returns:
        The instance with the diagonals (the "6th distances" of [MucherinoOmer2019, §4.4]) as intervals that hold the
        truth, and the one with every diagonal at its measured value.
    """
    corners = np.concatenate([np.eye(3), -np.eye(3)]) * [0.1, 0.12, 0.14]
    corners += 0.01 * np.random.default_rng(0).uniform(-1, 1, corners.shape)
    graph = frame_edges(("x", "y", "z", "−x", "−y", "−z"), corners)
    edges = graph.edges
    diagonal = edges.j - edges.i == 3
    measured = edges.lower * (1.0 + error * diagonal * np.random.default_rng(seed).uniform(-1, 1, len(edges)))
    slack = error * edges.lower * diagonal
    interval = graph.with_targets(lower=measured - slack, upper=measured + slack)
    return interval, graph.with_targets(lower=measured, upper=measured)


# Starts without an animation.

_PRESSING = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Weights of the additional dimensions, relative to an edge of priority 1."""


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

    def take(self, columns: np.ndarray) -> "Lifted":
        """Return the stress of some of the realizations."""
        return Lifted(self.stress.take(columns), self.kept, self.weight)


def random_starts(graph: PointGraph, count: int, seed: int = 0) -> Floats:
    """Return (count, T, V, K) points in a box with about one point per mean target distance [m].

    Args:
        count: number of starts.
        seed: of the random numbers.
    """
    middle = _middle(graph)
    spacing = float(middle.mean()) if len(middle) else 1.0
    size = spacing * (graph.frames * len(graph.vertices)) ** (1.0 / graph.dimension) / 2.0
    shape = (count, graph.frames, len(graph.vertices), graph.dimension)
    return np.random.default_rng(seed).uniform(-size, size, shape)


def lifted_starts(graph: PointGraph, count: int, seed: int = 0, extra: int = 2) -> Floats:
    """Return (count, T, V, K) random points drawn together in K + `extra` dimensions and flattened again [m].

    Sparse instances have many local minima; most of them disappear with room to pass around each other. The weight of
    the coordinates beyond K dimensions rises from 0 to 0.3. A solver continues from these points.

    Args:
        count: number of starts.
        seed: of the random numbers.
        extra: number of additional dimensions.
    """
    flat = random_starts(graph, count, seed)
    tall = graph.dimension + extra
    out = np.random.default_rng(seed).uniform(-0.5, 0.5, (*flat.shape[:-1], extra)) * np.abs(flat).max()
    z = np.concatenate([flat, out], axis=-1).reshape(count, -1).T
    stress = Reduced(operator(graph), intervals_of(graph.edges), Objective.SQUARED, tall)
    options = Spectral(max_iterations=300, value_tolerance=1e-12)
    for weight in _PRESSING:
        z = minimise(Lifted(stress, graph.dimension, weight), z, np.array(-np.inf), np.array(np.inf), options).z
    return z.T.reshape(*flat.shape[:-1], tall)[..., : graph.dimension]


def _middle(graph: PointGraph) -> Floats:
    lower, upper = graph.edges.lower, graph.edges.upper
    return (lower + np.where(np.isinf(upper), lower, upper)) / 2.0


def smoothness_edges(vertices: Sequence[str], animation: ArrayLike, priority: float = 1.0) -> PointGraph:
    """Return second differences of every object, δ = [0, ‖x^(t−1) − 2 x^t + x^(t+1)‖]: no rougher than the animation.

    Args:
        vertices: (V,) names.
        animation: (T, V, K) [m].
        priority: π of every edge.

    Raises:
        UsageError: there are fewer than three frames.
    """
    graph, x = empty(vertices, animation)
    if len(x) < 3:
        raise UsageError(f"second differences need three frames, got {len(x)}")
    most, everyone = np.zeros(x.shape[:2]), np.arange(x.shape[1])
    most[1:-1] = np.linalg.norm(np.diff(x, 2, axis=0), axis=-1)
    return replace(graph, tracks=(edge_track(SMOOTHNESS, graph, everyone, everyone, 0.0, most, priority),))


def nearest_realization(realizations: Realizations, previous: Floats) -> Floats:
    """Return the realization nearest to an earlier posture (V, K), moved rigidly onto it: an animation, frame by frame.

    Args:
        realizations: the result of the search.
        previous: (V, K) [m].

    Raises:
        GraphError: no realization exists.
    """
    if not len(realizations.positions):
        raise GraphError("no realization meets the distances; widen the tolerance or sample more")
    moved = [_onto(x, previous) for x in realizations.positions]
    return min(moved, key=lambda x: float(((x - previous) ** 2).sum()))


def _onto(x: Floats, target: Floats) -> Floats:
    """x moved rigidly (without mirroring) as near to the target as possible [Kabsch1976]."""
    a, b = x - x.mean(axis=0), target - target.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    sign = np.ones(len(left))
    sign[-1] = np.sign(np.linalg.det(left @ right))
    return a @ (left * sign) @ right + target.mean(axis=0)
