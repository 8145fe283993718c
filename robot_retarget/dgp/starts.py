"""Where to start when no animation is at hand."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.dgp.graph import Graph
from robot_retarget.errors import GraphError


def random_starts(graph: Graph, count: int, seed: int = 0) -> Floats:
    """(count, T, V, K) points in a box with about one point per mean distance asked for, [m]."""
    middle = _middle(graph)
    spacing = float(middle.mean()) if len(middle) else 1.0
    size = spacing * (graph.frames * len(graph.vertices)) ** (1.0 / graph.dimension) / 2.0
    shape = (count, graph.frames, len(graph.vertices), graph.dimension)
    return np.random.default_rng(seed).uniform(-size, size, shape)


def classical_start(graph: Graph, noise: float = 0.0, seed: int = 0) -> Floats:
    """Classical scaling of the shortest paths through the graph, (T, V, K) [m].

    Args:
        graph: its edges are taken in the middle of their interval.
        noise: relative change of each δ, to make several starts of one graph.
        seed: of the noise.

    Raises:
        GraphError: the graph is not connected; it names a vertex that cannot be reached.
    """
    from scipy.sparse import csr_array  # imported here so that importing the package stays fast
    from scipy.sparse.csgraph import shortest_path

    count = graph.frames * len(graph.vertices)
    length = _middle(graph) * np.exp(noise * np.random.default_rng(seed).normal(size=len(graph)))
    # A stored 0 would be no edge to the shortest path.
    table = csr_array((np.maximum(length, 1e-12), (graph.i, graph.j)), shape=(count, count))
    paths = shortest_path(table, directed=False)
    lost = np.flatnonzero(np.isinf(paths[0]))
    if lost.size:
        raise GraphError(
            f"the graph is not connected: no path of edges joins {graph.vertex_name(0)} and {graph.vertex_name(lost[0])}"
        )
    centring = np.eye(count) - 1.0 / count
    values, vectors = np.linalg.eigh(-0.5 * centring @ paths**2 @ centring)
    best = slice(-graph.dimension, None)
    x = vectors[:, best] * np.sqrt(np.maximum(values[best], 0.0))
    return x.reshape(graph.frames, len(graph.vertices), graph.dimension)


def _middle(graph: Graph) -> Floats:
    return np.where(np.isinf(graph.upper), graph.lower, (graph.lower + np.minimum(graph.upper, 1e300)) / 2.0)
