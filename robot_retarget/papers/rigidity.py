"""Conditions under which distances determine a shape: isometry, congruence, local and global rigidity.

Definition 2 of [MucherinoOmer2019] (every isometric pair is congruent) is global rigidity in the literature; the
sentence after it (no continuous deformation) is local rigidity. They differ, so this module has both. For generic
positions both depend only on the edges [Asimow1978], [GortlerHealyThurston2010]:

    local:   rank R = K n − K(K+1)/2 for the rigidity matrix R (for n > K),
    global:  local, and a generic equilibrium stress matrix Ω has rank n − K − 1.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import GraphError
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.skeletal import SkeletalStructure

_RANK = 1e-9
"""Singular values below this part of the largest are zero."""


def edge_lengths(positions: ArrayLike, edges: ArrayLike) -> Floats:
    """(…, E) lengths of the edges (E, 2) in positions (…, V, K) [m].

    Args:
        positions: (…, V, K) [m].
        edges: (E, 2) indices of both ends in V.
    """
    x, ends = np.asarray(positions, dtype=np.float64), _edges(edges, np.shape(positions)[-2])
    return np.sqrt(((x[..., ends[:, 0], :] - x[..., ends[:, 1], :]) ** 2).sum(axis=-1))


def isometric(first: ArrayLike, second: ArrayLike, edges: ArrayLike, tolerance: float = 1e-9) -> bool:
    """Whether two realizations give every edge the same length [MucherinoOmer2019, Definition 1].

    Args:
        first: (…, V, K) [m].
        second: (…, V, K) [m].
        edges: (E, 2) indices of both ends in V.
        tolerance: largest difference of a length [m].
    """
    return bool(np.abs(edge_lengths(first, edges) - edge_lengths(second, edges)).max(initial=0.0) <= tolerance)


def congruent(first: ArrayLike, second: ArrayLike, tolerance: float = 1e-9) -> bool:
    """Whether two realizations give every pair the same distance; mirror images are congruent.

    Args:
        first: (…, V, K) [m].
        second: (…, V, K) [m].
        tolerance: largest difference of a length [m].
    """
    count = np.shape(first)[-2]
    return isometric(first, second, np.stack(np.triu_indices(count, 1), axis=1), tolerance)


def rigidity_matrix(positions: ArrayLike, edges: ArrayLike) -> Floats:
    """R (…, E, V·K): row e is ½ ∂‖x_i − x_j‖²/∂x, that is x_i − x_j at i and its opposite at j.

    Args:
        positions: (…, V, K) [m].
        edges: (E, 2) indices of both ends in V.
    """
    x = np.asarray(positions, dtype=np.float64)
    count, axes = x.shape[-2:]
    ends = _edges(edges, count)
    r = x[..., ends[:, 0], :] - x[..., ends[:, 1], :]
    matrix = np.zeros((*x.shape[:-2], len(ends), count, axes))
    row = np.arange(len(ends))
    matrix[..., row, ends[:, 0], :] = r
    matrix[..., row, ends[:, 1], :] = -r
    return matrix.reshape(*x.shape[:-2], len(ends), count * axes)


def rigid_rank(count: int, dimension: int) -> int:
    """The rank of R of a rigid framework: K n − K(K+1)/2, or every pair where n ≤ K.

    Args:
        count: number of vertices n.
    """
    if count <= dimension:
        return count * (count - 1) // 2
    return dimension * count - dimension * (dimension + 1) // 2


def locally_rigid(edges: ArrayLike, count: int, dimension: int) -> bool:
    """Whether a generic framework of these edges has no continuous deformation.

    Args:
        edges: (E, 2) indices of both ends in V.
        count: number of vertices n.
    """
    return _rank(rigidity_matrix(_generic(count, dimension), edges)) == rigid_rank(count, dimension)


def stress_matrix_rank(edges: ArrayLike, count: int, dimension: int) -> int:
    """Rank of a generic equilibrium stress matrix Ω; 0 where the edges carry no stress.

    Args:
        edges: (E, 2) indices of both ends in V.
        count: number of vertices n.
    """
    x, ends = _generic(count, dimension), _edges(edges, count)
    left, values, _ = np.linalg.svd(rigidity_matrix(x, ends), full_matrices=True)
    free = left[:, _counted(values) :]
    if not free.shape[1]:
        return 0
    omega, weight = np.zeros((count, count)), free @ np.random.default_rng(1).normal(size=free.shape[1])
    omega[ends[:, 0], ends[:, 1]] = omega[ends[:, 1], ends[:, 0]] = -weight
    np.fill_diagonal(omega, -omega.sum(axis=1))
    return _rank(omega)


def globally_rigid(edges: ArrayLike, count: int, dimension: int) -> bool:
    """Whether a generic realization is the only one up to congruence: rigid in the sense of Definition 2.

    Args:
        edges: (E, 2) indices of both ends in V.
        count: number of vertices n.
    """
    pairs = {tuple(sorted(edge)) for edge in _edges(edges, count).tolist()}
    if count <= dimension + 1:
        return len(pairs) == count * (count - 1) // 2
    return (
        locally_rigid(edges, count, dimension) and stress_matrix_rank(edges, count, dimension) == count - dimension - 1
    )


def admits(graph: PointGraph, structure: SkeletalStructure, tolerance: float = 1e-9) -> bool:
    """Whether G admits (S, χ), [MucherinoOmer2019, Definition 3]: in every frame S ⊆ G_t with δ = ‖χ(u) − χ(v)‖.

    Args:
        structure: (S, χ).
        tolerance: largest difference of a length [m].
    """
    if not set(structure.names) <= set(graph.vertices):
        return False
    places = np.array([graph.vertices.index(name) for name in structure.names])
    bones, lengths = places[structure.bones], structure.lengths[1:]
    wanted = {frozenset(pair): length for pair, length in zip(bones.tolist(), lengths, strict=True)}
    met = set()
    size, edges = len(graph.vertices), graph.edges
    for edge in np.flatnonzero(edges.exact & (edges.i // size == edges.j // size)):
        pair = frozenset((int(edges.i[edge]) % size, int(edges.j[edge]) % size))
        if pair in wanted and abs(edges.lower[edge] - wanted[pair]) <= tolerance:
            met.add((int(edges.i[edge]) // size, pair))
    return len(met) == graph.frames * len(wanted)


def _edges(edges: ArrayLike, count: int) -> Ints:
    ends = np.asarray(edges, dtype=np.int64).reshape(-1, 2)
    wrong = np.flatnonzero(((ends < 0) | (ends >= count)).any(axis=1) | (ends[:, 0] == ends[:, 1]))
    if wrong.size:
        raise GraphError(f"edge {wrong[0]} joins {ends[wrong[0]].tolist()}: two different vertices of 0 … {count - 1}")
    return ends


def _generic(count: int, dimension: int) -> Floats:
    return np.random.default_rng(0).normal(size=(count, dimension))


def _rank(matrix: Any) -> int:
    return _counted(np.linalg.svd(matrix, compute_uv=False))


def _counted(values: Any) -> int:
    return int((values > _RANK * values.max(initial=0.0)).sum())
