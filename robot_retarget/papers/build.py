"""Instances from animations: the edge sets E* and E⁺ of [MucherinoOmer2019, §3–4]."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.graph.track import Track
from robot_retarget.human.motion import Motion
from robot_retarget.papers.edges import BONE, POSTURE, SEPARATION, PointKind, trace
from robot_retarget.papers.evaluation import distances
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.skeletal import SkeletalStructure
from robot_retarget.papers.solvers import PointSolution


def empty(vertices: Sequence[str], animation: ArrayLike) -> tuple[PointGraph, Floats]:
    """Return the graph of V × T without edges, and the animation (T, V, K), checked.

    Args:
        vertices: (V,) names.
        animation: (T, V, K) or (V, K) [m].

    Raises:
        GraphError: the animation is not (T, V, K) or (V, K) with K = 2 or 3.
    """
    x = np.array(animation, dtype=np.float64)
    x = x[None] if x.ndim == 2 else x
    if x.ndim != 3:
        raise GraphError(f"an animation is (frames, vertices, K), got {x.shape}")
    graph = PointGraph((), tuple(vertices), len(x), x.shape[2])
    return graph, graph.checked(x)


def edge_track(
    kind: PointKind,
    graph: PointGraph,
    i: Ints,
    j: Ints,
    lower: ArrayLike,
    upper: ArrayLike,
    priority: ArrayLike = 1.0,
) -> Track:
    """Return a track of E edges between objects.

    Args:
        graph: gives V × T.
        i: (E,) places of the first ends in V.
        j: (E,) places of the second ends.
        lower: least distances [m], broadcast to (T, E).
        upper: as `lower`.
        priority: π, broadcast to (T, E).
    """
    ends = tuple((graph.vertices[a], graph.vertices[b]) for a, b in zip(i, j, strict=True))
    low, high, weight = (
        np.broadcast_to(np.asarray(x, dtype=float), (graph.frames, len(ends))) for x in (lower, upper, priority)
    )
    return Track(kind, ends, low, high, weight, np.ones(len(ends)))


def trace_edges(vertices: Sequence[str], animation: ArrayLike, depth: int = 3, priority: float = 1.0) -> PointGraph:
    """Return E* of [MucherinoOmer2019, eq. 1]: each object to its own last `depth` positions (τ, 3 in the paper).

    ⋃_{t ≥ τ+1} E_v^(t−τ, t) is every pair of v with |q − t| ≤ τ: τ (2n − τ − 1)/2 edges per object.

    Args:
        vertices: (V,) names.
        animation: (T, V, K) [m].
        depth: τ.
        priority: π of every edge.

    Raises:
        UsageError: the depth is not within 1 … frames − 1.
    """
    graph, x = empty(vertices, animation)
    if not 1 <= depth < max(len(x), 2):
        raise UsageError(f"depth must be 1 … {len(x) - 1} for {len(x)} frames, got {depth}")
    everyone, tracks = np.arange(x.shape[1]), []
    for lag in range(1, depth + 1):
        delta = np.zeros(x.shape[:2])
        delta[lag:] = np.linalg.norm(x[lag:] - x[:-lag], axis=-1)
        tracks.append(edge_track(trace(lag), graph, everyone, everyone, delta, delta, priority))
    return replace(graph, tracks=tuple(tracks))


def frame_edges(vertices: Sequence[str], animation: ArrayLike, priority: ArrayLike = 1.0) -> PointGraph:
    """Return E* = ⋃_t E_t, every pair of every frame: the second method of [MucherinoOmer2019, §4.1].

    The paper's text says inter-frame where its formula and argument say intra-frame.

    Args:
        vertices: (V,) names.
        animation: (T, V, K) or (V, K) [m].
        priority: π, a scalar or one per pair of `numpy.triu_indices(V, 1)`.
    """
    graph, x = empty(vertices, animation)
    i, j = np.triu_indices(x.shape[1], 1)
    return replace(graph, tracks=(measured(POSTURE, graph, x, i, j, priority),))


def measured(
    kind: PointKind, graph: PointGraph, animation: Floats, i: Ints, j: Ints, priority: ArrayLike = 1.0
) -> Track:
    """Return a track of exact edges whose δ is the distance of two objects in the animation.

    Args:
        graph: gives V × T.
        animation: (T, V, K) [m].
        i: (E,) places of the first ends in V.
        j: (E,) places of the second ends.
        priority: π, broadcast to (T, E).
    """
    delta = np.linalg.norm(animation[:, i] - animation[:, j], axis=-1)
    return edge_track(kind, graph, i, j, delta, delta, priority)


def motion_graph(
    motion: Motion | ArrayLike,
    names: Sequence[str] | None = None,
    *,
    postures: bool = True,
    traces: int = 3,
    fixed: Sequence[str] = (),
) -> PointGraph:
    """Return E* of a motion: exact edges δ = d(x) whose realization of zero stress is the motion itself.

    Args:
        motion: a motion with a skeleton, whose bones are edges of kind `BONE`; or positions (T, V, K) of objects [m].
        names: names of the objects; by default those of the motion, or numbers.
        postures: add every pair of every frame, ⋃ E_t; omit them if objects move independently, as in a crowd.
        traces: number of past positions joined to every object, ⋃ E_v with τ; 0 omits them.
        fixed: objects that do not move, such as obstacles.

    Raises:
        GraphError: positions of another shape or not finite, or an unknown object.
        UsageError: fewer frames than traces need.
    """
    if isinstance(motion, Motion):
        graph, x = empty(motion.skeleton.names, motion.positions)
        parents = np.asarray(motion.skeleton.parents, dtype=np.int64)
    else:
        x = np.asarray(motion, dtype=np.float64)
        numbered = [str(k) for k in range(x.shape[-2] if x.ndim > 1 else 0)]
        graph, x = empty(numbered if names is None else names, x)
        parents = np.full(len(graph.vertices), -1)
    i, j = np.triu_indices(len(parents), 1)
    bone = (parents[i] == j) | (parents[j] == i)
    tracks = [measured(BONE, graph, x, i[bone], j[bone])] if bone.any() else []
    if postures and not bone.all():
        tracks.append(measured(POSTURE, graph, x, i[~bone], j[~bone]))
    within = replace(graph, tracks=tuple(tracks))
    whole = within.joined(trace_edges(graph.vertices, x, traces)) if traces and len(x) > 1 else within
    held = [whole.place(name) for name in fixed]
    return replace(whole, fixed=np.isin(np.arange(len(whole.vertices)), held))


def bone_edges(graph: PointGraph, structure: SkeletalStructure, priority: float = 10.0) -> PointGraph:
    """Return the bones of (S, χ) in every frame of a graph, δ = ‖χ(u) − χ(v)‖, [MucherinoOmer2019, Definition 3].

    Args:
        graph: gives V × T.
        structure: (S, χ).
        priority: π of every bone.

    Raises:
        GraphError: a joint is no vertex of the graph.
    """
    places = np.array([graph.place(name) for name in structure.names])
    parent, child = structure.bones.T
    lengths = structure.lengths[1:]
    return replace(graph, tracks=(edge_track(BONE, graph, places[parent], places[child], lengths, lengths, priority),))


def pair_edges(
    graph: PointGraph,
    pairs: Sequence[tuple[str, str]],
    lower: ArrayLike,
    upper: ArrayLike = np.inf,
    *,
    kind: PointKind = SEPARATION,
    priority: ArrayLike = 10.0,
) -> PointGraph:
    """Return edges between named objects in every frame (from the second on for `INTERACTION`).

    Args:
        graph: gives V × T.
        pairs: the objects, by name.
        lower: least distance of each pair [m], a scalar or one per pair.
        upper: greatest distance [m].
        priority: of each pair.

    Raises:
        GraphError: an unknown object.
    """
    ends = np.array([[graph.place(name) for name in pair] for pair in pairs], dtype=np.int64).reshape(-1, 2)
    return replace(graph, tracks=(edge_track(kind, graph, ends[:, 0], ends[:, 1], lower, upper, priority),))


def solve_with_thresholds(
    base: PointGraph,
    candidates: PointGraph,
    start: ArrayLike,
    solver: Callable[[PointGraph, Floats], PointSolution],
    *,
    tolerance: float = 1e-4,
    rounds: int = 10,
) -> PointSolution:
    """Solve E* ∪ E⁺, and detect E⁺ again in the solution until no pair violates its threshold.

    A single detection in the original animation misses frames that become violated during the solution.

    Args:
        base: E*, with boxes and fixed vertices.
        candidates: every pair that may be separated, δ = [Δ, ∞].
        start: the original animation (T, V, K) [m].
        solver: from a graph and a start to a solution, such as `solve`.
        tolerance: a smaller violation is ignored [m].
        rounds: maximum number of rounds.

    Returns:
        The solution of the last round.
    """
    x = base.checked(start)
    chosen = _closer(candidates, x, 0.0)
    solution = solver(base.joined(candidates.select(chosen)), x)
    for _ in range(rounds - 1):
        violated = _closer(candidates, solution.positions, -tolerance)
        if not (violated & ~chosen).any():
            break
        chosen |= violated
        solution = solver(base.joined(candidates.select(chosen)), solution.positions)
    return solution


def _closer(candidates: PointGraph, x: Floats, slack: float) -> NDArray[np.bool_]:
    return distances(candidates, x) <= candidates.edges.lower + slack
