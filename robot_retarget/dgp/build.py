"""Instances from animations: the edge sets E* and E⁺ of [MucherinoOmer2019, §3–4]."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.arrays import Floats, Ints
from robot_retarget.dgp.graph import Animated, Graph, Kind
from robot_retarget.dgp.skeletal import SkeletalStructure
from robot_retarget.dgp.solution import Solution
from robot_retarget.dgp.stress import distances
from robot_retarget.errors import GraphError, UsageError, known


def empty(vertices: Sequence[str], animation: ArrayLike) -> tuple[Graph, Floats]:
    """The graph of V × T without edges, and the animation (T, V, K) it is drawn from, checked.

    Raises:
        GraphError: the animation is not (T, V, K) or (V, K) with K = 2 or 3.
    """
    x = np.array(animation, dtype=np.float64)
    x = x[None] if x.ndim == 2 else x
    if x.ndim != 3:
        raise GraphError(f"an animation is (frames, vertices, K), got {x.shape}")
    ends, bounds = np.zeros(0, dtype=np.int64), np.zeros(0)
    graph = Graph(tuple(vertices), len(x), x.shape[2], ends, ends, bounds, bounds)
    return graph, graph.checked(x)


def measured(graph: Graph, animation: Floats, i: Ints, j: Ints, kind: Kind, priority: ArrayLike = 1.0) -> Graph:
    """The graph with exact edges whose δ is the distance in the animation."""
    bare = replace(graph, i=i, j=j, lower=0.0, upper=np.inf, priority=priority, kind=int(kind), huber_delta=np.inf)
    delta = distances(bare, animation)
    return replace(bare, lower=delta, upper=delta)


def trace_edges(vertices: Sequence[str], animation: ArrayLike, depth: int = 3, priority: float = 1.0) -> Graph:
    """E* of [MucherinoOmer2019, eq. 1]: each object to its own last `depth` positions (τ, 3 in the paper).

    ⋃_{t ≥ τ+1} E_v^(t−τ, t) is every pair of v with |q − t| ≤ τ: τ (2n − τ − 1)/2 edges per object.

    Raises:
        UsageError: the depth is not within 1 … frames − 1.
    """
    graph, x = empty(vertices, animation)
    if not 1 <= depth < max(len(x), 2):
        raise UsageError(f"depth must be 1 … {len(x) - 1} for {len(x)} frames, got {depth}")
    size = x.shape[1]
    pairs = [(np.arange((len(x) - lag) * size), np.arange(lag * size, len(x) * size)) for lag in range(1, depth + 1)]
    i, j = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return measured(graph, x, i, j, Kind.TRACE, priority)


def frame_edges(vertices: Sequence[str], animation: ArrayLike, priority: ArrayLike = 1.0) -> Graph:
    """E* = ⋃_t E_t, every pair of every frame: the second method of [MucherinoOmer2019, §4.1].

    The paper's text says inter-frame where its formula and argument say intra-frame.
    """
    graph, x = empty(vertices, animation)
    i, j = every_frame(*np.triu_indices(x.shape[1], 1), graph)
    pairs = x.shape[1] * (x.shape[1] - 1) // 2
    return measured(graph, x, i, j, Kind.POSTURE, np.tile(np.broadcast_to(priority, pairs), len(x)))


def motion_edges(motion: Animated | ArrayLike, names: Sequence[str] | None, postures: bool, traces: int) -> Graph:
    """E* of a motion, or of places (T, V, K): see `Graph.of`."""
    if isinstance(motion, Animated):
        graph, x = empty(motion.skeleton.names, motion.positions)
        parents = np.asarray(motion.skeleton.parents, dtype=np.int64)
    else:
        x = np.asarray(motion, dtype=np.float64)
        numbered = [str(k) for k in range(x.shape[-2] if x.ndim > 1 else 0)]
        graph, x = empty(numbered if names is None else names, x)
        parents = np.full(len(graph.vertices), -1)
    i, j = np.triu_indices(len(parents), 1)
    bone = (parents[i] == j) | (parents[j] == i)
    kept = bone | postures
    kind = np.tile(np.where(bone, Kind.BONE, Kind.POSTURE)[kept], graph.frames)
    within = replace(measured(graph, x, *every_frame(i[kept], j[kept], graph), Kind.POSTURE), kind=kind)
    return within.joined(trace_edges(graph.vertices, x, traces)) if traces and len(x) > 1 else within


def bone_edges(graph: Graph, structure: SkeletalStructure, priority: float = 10.0) -> Graph:
    """The bones of (S, χ) in every frame of a graph, δ = ‖χ(u) − χ(v)‖, [MucherinoOmer2019, Definition 3].

    Raises:
        GraphError: a joint is no vertex of the graph.
    """
    places = np.array([_place(graph, name) for name in structure.names])
    parent, child = structure.bones.T
    i, j = every_frame(places[parent], places[child], graph)
    delta = np.tile(structure.lengths[1:], graph.frames)
    return replace(
        graph, i=i, j=j, lower=delta, upper=delta, priority=priority, kind=int(Kind.BONE), huber_delta=np.inf
    )


def pair_edges(
    graph: Graph,
    pairs: Sequence[tuple[str, str]],
    lower: ArrayLike,
    upper: ArrayLike = np.inf,
    *,
    kind: Kind = Kind.SEPARATION,
    priority: ArrayLike = 10.0,
) -> Graph:
    """Edges between named objects in every frame (from the second on for `INTERACTION`).

    Args:
        graph: gives V × T.
        pairs: the objects, by name.
        lower: least distance of each pair [m], a scalar or one per pair.
        upper: greatest distance [m].
        kind: of the edges.
        priority: of each pair.

    Raises:
        GraphError: an unknown object.
    """
    ends = np.array([[_place(graph, name) for name in pair] for pair in pairs], dtype=np.int64).reshape(-1, 2)
    first = 1 if kind is Kind.INTERACTION else 0
    i, j = every_frame(ends[:, 0], ends[:, 1], graph, first)
    columns = {
        name: np.tile(np.broadcast_to(np.asarray(value, dtype=np.float64), len(ends)), graph.frames - first)
        for name, value in (("lower", lower), ("upper", upper), ("priority", priority))
    }
    return replace(graph, i=i, j=j, kind=int(kind), huber_delta=np.inf, **columns)


def smoothness_edges(vertices: Sequence[str], animation: ArrayLike, priority: float = 1.0) -> Graph:
    """Second differences of every object, δ = [0, ‖x^(t−1) − 2 x^t + x^(t+1)‖]: no rougher than the animation.

    Raises:
        UsageError: there are fewer than three frames.
    """
    graph, x = empty(vertices, animation)
    if len(x) < 3:
        raise UsageError(f"second differences need three frames, got {len(x)}")
    i = np.arange((len(x) - 2) * x.shape[1])
    exact = measured(graph, x, i, i + 2 * x.shape[1], Kind.SMOOTHNESS, priority)
    return replace(exact, lower=0.0)


def every_frame(u: Ints, v: Ints, graph: Graph, first: int = 0) -> tuple[Ints, Ints]:
    """Ids of pairs of objects (places in V) repeated in the frames from `first` on, frame after frame."""
    offsets = np.arange(first, graph.frames)[:, None] * len(graph.vertices)
    return (offsets + u).ravel(), (offsets + v).ravel()


def threshold_edges(candidates: Graph, animation: ArrayLike) -> Graph:
    """E⁺ of [MucherinoOmer2019, eq. 2]: the candidates whose pair is within its lower bound in the animation."""
    return candidates.select(_closer(candidates, candidates.checked(animation), 0.0))


def solve_with_thresholds(
    base: Graph,
    candidates: Graph,
    start: ArrayLike,
    solver: Callable[[Graph, Floats], Solution],
    *,
    tolerance: float = 1e-4,
    rounds: int = 10,
) -> Solution:
    """Solve E* ∪ E⁺, and detect E⁺ again in the solution until no pair violates its threshold.

    A single detection in the original animation misses frames that become violated during the solution.

    Args:
        base: E*, with boxes and fixed vertices.
        candidates: every pair that may be separated, δ = [Δ, ∞].
        start: the original animation (T, V, K) [m].
        solver: from a graph and a start to a solution, such as `solve`.
        tolerance: a smaller violation is ignored [m].
        rounds: maximum number of rounds.
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


def _closer(candidates: Graph, x: Floats, slack: float) -> NDArray[np.bool_]:
    return distances(candidates, x) <= candidates.lower + slack


def _place(graph: Graph, name: str) -> int:
    if name not in graph.vertices:
        raise GraphError(f"unknown vertex {name!r}; {known(graph.vertices)}")
    return graph.vertices.index(name)
