"""Starts without an animation."""

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError
from robot_retarget.graph.track import Objective
from robot_retarget.papers.columns import Lifted, Reduced
from robot_retarget.papers.evaluation import intervals_of, operator
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.spectral import Spectral, minimise

_PRESSING = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Weights of the additional dimensions, relative to an edge of priority 1."""


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


def classical_start(graph: PointGraph, noise: float = 0.0, seed: int = 0) -> Floats:
    """Return the classical scaling of the shortest paths through the graph, (T, V, K) [m].

    Args:
        graph: every edge counts with the middle of its interval.
        noise: relative change of each δ, to make several starts of one graph.
        seed: seed of the noise.

    Raises:
        GraphError: the graph is not connected; the message names an unreachable vertex.
    """
    from scipy.sparse import csr_array  # imported here so that importing the package stays fast
    from scipy.sparse.csgraph import shortest_path

    count = graph.frames * len(graph.vertices)
    length = _middle(graph) * np.exp(noise * np.random.default_rng(seed).normal(size=len(graph.edges)))
    # A stored 0 would be no edge to the shortest path.
    table = csr_array((np.maximum(length, 1e-12), (graph.edges.i, graph.edges.j)), shape=(count, count))
    paths = shortest_path(table, directed=False)
    lost = np.flatnonzero(np.isinf(paths[0]))
    if lost.size:
        raise GraphError(
            f"the graph is not connected: no path of edges joins {graph.edges.vertex_name(0)} and {graph.edges.vertex_name(lost[0])}"
        )
    centring = np.eye(count) - 1.0 / count
    values, vectors = np.linalg.eigh(-0.5 * centring @ paths**2 @ centring)
    best = slice(-graph.dimension, None)
    x = vectors[:, best] * np.sqrt(np.maximum(values[best], 0.0))
    return x.reshape(graph.frames, len(graph.vertices), graph.dimension)


def _middle(graph: PointGraph) -> Floats:
    lower, upper = graph.edges.lower, graph.edges.upper
    return (lower + np.where(np.isinf(upper), lower, upper)) / 2.0
