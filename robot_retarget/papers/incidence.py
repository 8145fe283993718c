"""From coordinates to the difference vector of every edge, and back: the linear part of every stress."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.interaction import Interaction, steps_ahead
from robot_retarget.papers.edges import Distance, Edges

_DENSE = 20_000
"""Up to this many entries a dense product beats the overhead of a sparse one."""


@dataclass(frozen=True)
class Incidence:
    """r = A x + k ∘ (S x): A takes one end of each edge from the other, S the relative step of an interaction edge.

    k is 0 on Euclidean edges and the steps ahead of `interaction.steps_ahead` on the others, where it follows x.
    """

    ends: Any
    """A, (E, N) dense or sparse."""
    ends_t: Any
    steps: Any
    """S, (E, N) sparse, or None where every edge is Euclidean."""
    steps_t: Any
    interaction: Interaction

    def differences(self, x: Floats) -> tuple[Floats, Floats | None]:
        """Return r (E, K, B) of x (N, K, B) [m], and k (E, B)."""
        flat = x.reshape(len(x), -1)
        r = (self.ends @ flat).reshape(-1, *x.shape[1:])
        if self.steps is None:
            return r, None
        w = (self.steps @ flat).reshape(r.shape)
        k = steps_ahead((r * w).sum(1), (w * w).sum(1), self.interaction)
        return r + k[:, None] * w, k

    def gather(self, forces: Floats, k: Floats | None) -> Floats:
        """Return Aᵀ f + Sᵀ (k ∘ f), (N, K, B): the sums of the edges' pulls f (E, K, B) at each vertex.

        Args:
            forces: f (E, K, B).
            k: (E, B) steps ahead, None where every edge is Euclidean.
        """
        flat = forces.reshape(len(forces), -1)
        total = self.ends_t @ flat
        if k is not None:
            total = total + self.steps_t @ (k[:, None] * forces).reshape(flat.shape)
        return total.reshape(-1, *forces.shape[1:])

    def members(self, edges: Edges, k: Floats | None) -> tuple[Ints, Floats]:
        """Return the vertices (E, m) of each difference and their coefficients (E, m), at constant k.

        Args:
            edges: E edges.
            k: (E, 1) steps ahead, None where every edge is Euclidean.
        """
        ids, coefficients = _members(edges)
        if k is None:
            return ids, coefficients
        earlier = np.where((edges.distance == Distance.INTERACTION)[:, None], ids - len(edges.vertices), ids)
        return np.concatenate([ids, earlier], axis=1), np.concatenate([coefficients * (1 + k), -coefficients * k], 1)


def incidence(edges: Edges, interaction: Interaction) -> Incidence:
    """Return the operator of E edges.

    Args:
        edges: E edges over V × T.
        interaction: the measure of interaction edges.
    """
    shape = len(edges), edges.frames * len(edges.vertices)
    ids, coefficients = _members(edges)
    ends = _matrix(ids, coefficients, shape)
    moving = (edges.distance == Distance.INTERACTION)[:, None] * coefficients
    back = np.where(moving != 0, ids - len(edges.vertices), ids)
    steps = _matrix(ids, moving, shape) - _matrix(back, moving, shape) if moving.any() else None
    if shape[0] * shape[1] <= _DENSE:
        ends = ends.toarray()
    return Incidence(
        ends=ends,
        ends_t=_turned(ends),
        steps=steps,
        steps_t=None if steps is None else steps.T.tocsr(),
        interaction=interaction,
    )


def _members(edges: Edges) -> tuple[Ints, Floats]:
    """Return the terms of x_j − x_i, or of x_j + x_i − 2 x_middle for edges of smoothness."""
    smooth = (edges.distance == Distance.SECOND_DIFFERENCE)[:, None]
    if not smooth.any():
        return np.stack([edges.j, edges.i], axis=1), np.tile([1.0, -1.0], (len(edges), 1))
    middle = np.where(smooth[:, 0], (edges.i + edges.j) // 2, edges.i)
    return np.stack([edges.j, edges.i, middle], axis=1), np.where(smooth, [1.0, 1.0, -2.0], [1.0, -1.0, 0.0])


def _matrix(ids: Ints, coefficients: Floats, shape: tuple[int, int]) -> Any:
    from scipy import sparse  # imported here so that importing the package stays fast

    row = np.repeat(np.arange(shape[0]), ids.shape[1])
    return sparse.csr_array((coefficients.ravel(), (row, ids.ravel())), shape=shape)


def _turned(matrix: Any) -> Any:
    return np.ascontiguousarray(matrix.T) if isinstance(matrix, np.ndarray) else matrix.T.tocsr()
