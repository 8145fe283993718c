"""Branch and prune: every realization of a discretizable instance, [MucherinoOmer2019, §4.4].

Each vertex after a first clique of K has at least K earlier references, so it lies at the intersection of K spheres:
two positions, a binary tree. A branch ends if it misses a further distance (a pruning device). One of the references
may be an interval; it is sampled. Distances that place a vertex are exact to rounding.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import GraphError
from robot_retarget.papers.points import PointGraph

# Where K spheres of K-dimensional space meet: at most two points, mirror images in the plane of the centres.


def intersect(centres: Floats, radii: Floats, tolerance: float = 1e-9) -> Floats:
    """The points x with ‖x − c_m‖ = r_m, m = 1 … K.

    Subtracting the first equation leaves K − 1 planes, which meet in a line; the line meets the first sphere at
    s² = r_1² − ‖y‖². A negative s² down to −tolerance · r_1² counts as touching.

    Args:
        centres: (…, K, K), one centre a row, K = 2 or 3 [m].
        radii: (…, K) [m].
        tolerance: relative slack of a touching pair.

    Returns:
        (2, …, K) [m]; NaN where the spheres do not meet or the centres do not span a hyperplane.
    """
    origin, spans = centres[..., 0, :], centres[..., 1:, :] - centres[..., :1, :]
    r, others = radii[..., :1], radii[..., 1:]
    known = (r**2 - others**2 + (spans**2).sum(-1)) / 2.0
    normal = _normal(spans)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = normal / length
        square = np.concatenate([spans, normal[..., None, :]], axis=-2)
        flat = ~(length[..., 0] > 1e-12 * (spans**2).sum((-1, -2)))
        square[flat] = np.eye(square.shape[-1])
        along = np.concatenate([known, np.zeros_like(r)], axis=-1)
        foot = np.linalg.solve(square, along[..., None])[..., 0]
        height = r[..., 0] ** 2 - (foot**2).sum(-1)
        height = np.where((height < 0) & (height >= -tolerance * r[..., 0] ** 2), 0.0, height)
        rise = np.sqrt(height)[..., None] * normal
    rise[flat] = np.nan
    return np.stack([origin + foot + rise, origin + foot - rise])


def _normal(spans: Floats) -> Floats:
    """Perpendicular to K − 1 vectors (…, K − 1, K); its length is the area they span."""
    if spans.shape[-1] == 2:
        return np.stack([-spans[..., 0, 1], spans[..., 0, 0]], axis=-1)
    return np.cross(spans[..., 0, :], spans[..., 1, :])


@dataclass(frozen=True)
class Branching:
    """Parameters of the search."""

    tolerance: float = 1e-6
    """Tolerance of a pruning distance [m]."""
    samples: int = 11
    """Number of samples of an interval reference."""
    solutions: int = 10_000
    """Maximum number of solutions."""
    nodes: int = 1_000_000
    """Maximum number of placed vertices."""


@dataclass(frozen=True)
class Realizations:
    """The result of the search."""

    positions: Floats
    """(S, V, K) [m], the first vertex at the origin; both mirror images are included."""
    order: Ints
    """(V,) the vertices in the order of their placement."""
    nodes: int
    """Number of placed vertices."""
    complete: bool
    """Whether the whole tree was searched."""


def discretization_order(graph: PointGraph) -> Ints:
    """Return an order with an exact clique of K vertices, then vertices with K earlier references, ≤ 1 an interval.

    Raises:
        GraphError: no order exists; the message names the vertex that no order reaches.
    """
    if graph.frames != 1:
        raise GraphError(f"branch and prune takes one frame at a time, the graph has {graph.frames}: use at_frame(t)")
    exact, any_ = _adjacency(graph, graph.edges.exact), _adjacency(graph, np.ones(len(graph.edges), dtype=bool))
    best: list[int] = []
    for clique in _cliques(exact, graph.dimension):
        order = _extended(clique, exact, any_, graph.dimension)
        if len(order) == len(graph.vertices):
            return np.array(order)
        best = max(best, order, key=len)
    if not best:
        raise GraphError(f"no {graph.dimension} vertices are joined pairwise by exact edges")
    left = next(vertex for vertex in range(len(graph.vertices)) if vertex not in best)
    raise GraphError(
        f"not discretizable: vertex {graph.vertices[left]!r} has {int(any_[left, best].sum())} references "
        f"({int(exact[left, best].sum())} exact) where {graph.dimension} are needed, at most one an interval"
    )


def branch_and_prune(graph: PointGraph, options: Branching | None = None) -> Realizations:
    """Search the tree of a posture (T = {1}) depth first.

    Args:
        graph: an instance of one frame.

    Raises:
        GraphError: the instance is not discretizable, or has more than one frame.
    """
    options, order = options or Branching(), discretization_order(graph)
    table = _Table(graph)
    root = np.full((len(graph.vertices), graph.dimension), np.nan)
    root[order[: graph.dimension]] = _clique_positions(table, order[: graph.dimension])
    stack, found, nodes = [(root, graph.dimension)], [], graph.dimension
    while stack and len(found) < options.solutions and nodes < options.nodes:
        x, depth = stack.pop()
        if depth == len(order):
            found.append(x)
            continue
        for point in _places(table, x, order[:depth], order[depth], options):
            child = x.copy()
            child[order[depth]] = point
            stack.append((child, depth + 1))
            nodes += 1
    positions = np.array(found).reshape(-1, *root.shape)
    return Realizations(positions, order, nodes, complete=not stack)


class _Table:
    """Bounds between every two vertices: the intersection of their edges, [0, ∞] without edges."""

    def __init__(self, graph: PointGraph):
        count, edges = len(graph.vertices), graph.edges
        self.lower, self.upper = np.zeros((count, count)), np.full((count, count), np.inf)
        for a, b in ((edges.i, edges.j), (edges.j, edges.i)):
            np.maximum.at(self.lower, (a, b), edges.lower)
            np.minimum.at(self.upper, (a, b), edges.upper)
        self.exact, self.joined = _adjacency(graph, edges.exact), _adjacency(graph, np.ones(len(edges), dtype=bool))


def _adjacency(graph: PointGraph, edges: NDArray[np.bool_]) -> NDArray[np.bool_]:
    joined = np.zeros((len(graph.vertices), len(graph.vertices)), dtype=bool)
    i, j = graph.edges.i[edges], graph.edges.j[edges]
    joined[i, j] = joined[j, i] = True
    return joined


def _cliques(joined: NDArray[np.bool_], size: int) -> Iterator[tuple[int, ...]]:
    """Cliques of the given size, those with the best-connected vertices first."""
    by_degree = np.argsort(-joined.sum(axis=1), kind="stable").tolist()
    for vertices in combinations(by_degree, size):
        if all(joined[a, b] for a, b in combinations(vertices, 2)):
            yield vertices


def _extended(clique: Sequence[int], exact: NDArray[np.bool_], joined: NDArray[np.bool_], dimension: int) -> list[int]:
    """Return an order that begins with a clique; next is the vertex with the most exact references, while one has enough."""
    order = list(clique)
    left = set(range(len(joined))) - set(order)
    while left:
        score = {v: (int(exact[v, order].sum()), int(joined[v, order].sum())) for v in left}
        vertex = max(sorted(left), key=score.__getitem__)
        if score[vertex][0] < dimension - 1 or score[vertex][1] < dimension:
            break
        order.append(vertex)
        left.remove(vertex)
    return order


def _clique_positions(table: _Table, clique: Ints) -> Floats:
    """The first K vertices, each in the span of one axis more, on its positive side."""
    d = table.lower[np.ix_(clique, clique)]
    x = np.zeros((len(clique), len(clique)))
    x[1, 0] = d[0, 1]
    if len(clique) == 3:
        x[2, 0] = (d[0, 2] ** 2 + d[0, 1] ** 2 - d[1, 2] ** 2) / (2.0 * d[0, 1])
        x[2, 1] = np.sqrt(max(d[0, 2] ** 2 - x[2, 0] ** 2, 0.0))
    return x


def _places(table: _Table, x: Floats, placed: Ints, vertex: int, options: Branching) -> Floats:
    """Where a vertex may go: the meetings of its reference spheres that no other distance forbids."""
    references = placed[table.exact[vertex, placed]]
    axes = x.shape[1]
    if len(references) >= axes:
        chosen = _spread(x, references, axes)
        radii = table.lower[vertex, chosen][None]
    else:
        intervals = placed[table.joined[vertex, placed] & ~table.exact[vertex, placed]]
        widths = table.upper[vertex, intervals] - table.lower[vertex, intervals]
        chosen = np.append(references, intervals[widths.argmin()])
        tried = np.linspace(table.lower[vertex, chosen[-1]], table.upper[vertex, chosen[-1]], options.samples)
        radii = np.column_stack([np.tile(table.lower[vertex, references], (len(tried), 1)), tried])
    points = intersect(np.broadcast_to(x[chosen], (len(radii), axes, axes)), radii).reshape(-1, axes)
    points = points[np.isfinite(points).all(axis=1)]
    witnesses = placed[table.joined[vertex, placed]]
    apart = np.linalg.norm(points[:, None] - x[witnesses], axis=-1)
    low, high = table.lower[vertex, witnesses], table.upper[vertex, witnesses]
    within = (apart >= low - options.tolerance) & (apart <= high + options.tolerance)
    points = points[within.all(axis=1)]
    touching = len(points) == 2 and np.abs(points[0] - points[1]).max() <= options.tolerance
    return points[:1] if touching else points


def _spread(x: Floats, references: Ints, axes: int) -> Ints:
    """K references that span a wide hyperplane, so that the meeting point is well determined."""
    first = references[0]
    second = references[np.linalg.norm(x[references] - x[first], axis=1).argmax()]
    if axes == 2:
        return np.array([first, second])
    along = x[second] - x[first]
    area = np.linalg.norm(np.cross(x[references] - x[first], along), axis=1)
    return np.array([first, second, references[area.argmax()]])
