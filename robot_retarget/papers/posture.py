"""A posture for another body: normalised distances of [Mucherino2017, §II].

    τ_uv = Σ δ over the bones of the path P_uv,    D̄_uv = ‖x_u − x_v‖ / τ_uv^(1),    δ_uv = τ_uv^(2) D̄_uv,
    π_uv = (|P_max| − |P_uv| + 2) / |P_max|,       |P| counts the vertices of the path.

D̄ is 1 on a bone and 1 elsewhere only for a stretched limb; contact is 0. A uniformly scaled body gets an exact
Euclidean distance matrix, any other one an approximate one.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.errors import GraphError, UsageError, known
from robot_retarget.graph.interaction import Interaction, interaction_distance
from robot_retarget.graph.track import Track
from robot_retarget.human.match import NEAR, normalised_distances, path_priorities, path_weights
from robot_retarget.papers.build import edge_track, empty
from robot_retarget.papers.edges import BONE, INTERACTION, POSTURE, PointKind
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.skeletal import SkeletalStructure, transfer_directions


@dataclass(frozen=True)
class Blend:
    """Near pairs follow their normalised distance, free limbs the bone directions of the source.

    near = exp(−(D̄/reach)²), δ = near · τ^(2) D̄ + (1 − near) · δ_directions, π → π (base + gain · near).
    """

    reach: float = NEAR
    base: float = 0.2
    gain: float = 20.0


def adapt(
    positions: ArrayLike,
    source: SkeletalStructure,
    target: SkeletalStructure,
    blend: Blend | None = None,
    interaction: Interaction | None = None,
) -> PointGraph:
    """The instance whose solution is the posture of `source` on the body of `target`.

    Bones are edges of kind `BONE` (hard under `Ipopt`), other pairs `POSTURE`; every edge is exact.

    Args:
        positions: (T, V, K) or (V, K) postures of the source [m].
        source: its body; the displacements' lengths are read.
        target: a body with the same tree.
        blend: keep free limbs in their directions; None is the paper.
        interaction: measure pairs that no bone joins by the interaction distance D from the second frame on, δ = τ^(2) D/τ^(1):
            the dynDGP that [Mucherino2019] leaves to future work. Start its solver from the solution without.

    Raises:
        GraphError: the postures do not fit the body, or the bodies have different trees.
        UsageError: a blend of interaction distances is requested; it would mix two measures.
    """
    if blend is not None and interaction is not None:
        raise UsageError("adapt blends Euclidean distances only: give a blend or an interaction")
    if source.names != target.names or not np.array_equal(source.parents, target.parents):
        odd = [name for name in source.names if name not in target.names] or ["the order of the joints"]
        raise GraphError(f"both bodies need one tree; they differ in {odd[0]}; target {known(target.names)}")
    graph, x = empty(source.names, positions)
    u, v = np.triu_indices(len(source.names), 1)
    near_matrix = normalised_distances(x, source.parents, source.lengths)[:, u, v]
    delta = path_weights(target.parents, target.lengths)[u, v] * near_matrix
    priority = np.broadcast_to(path_priorities(source.parents)[u, v], delta.shape)
    bone = (source.parents[u] == v) | (source.parents[v] == u)
    if blend is not None:
        directed = transfer_directions(x, target.parents, target.lengths)
        apart = np.linalg.norm(directed[:, u] - directed[:, v], axis=-1)
        near = np.where(bone, 1.0, np.exp(-((near_matrix / blend.reach) ** 2)))
        delta = near * delta + (1.0 - near) * apart
        priority = np.where(bone, priority, priority * (blend.base + blend.gain * near))
    tracks = [_track(BONE, graph, u, v, bone, delta, priority), _track(POSTURE, graph, u, v, ~bone, delta, priority)]
    if interaction is not None:
        ahead = interaction_distance(x[:-1], x[1:], horizon=interaction.horizon, dead_band=interaction.dead_band)[0]
        ratio = path_weights(target.parents, target.lengths)[u, v] / path_weights(source.parents, source.lengths)[u, v]
        delta = np.concatenate([delta[:1], ratio * ahead])
        first = np.arange(len(x))[:, None] == 0
        tracks[1] = replace(tracks[1], priority=np.where(first, tracks[1].priority, 0.0))
        tracks.append(_track(INTERACTION, graph, u, v, ~bone, delta, priority))
    return replace(graph, tracks=tuple(tracks), interaction=interaction or graph.interaction)


def _track(
    kind: PointKind, graph: PointGraph, u: Ints, v: Ints, chosen: Bools, delta: Floats, priority: Floats
) -> Track:
    """Return the chosen pairs as exact edges."""
    return edge_track(kind, graph, u[chosen], v[chosen], delta[:, chosen], delta[:, chosen], priority[:, chosen])
