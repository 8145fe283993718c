"""A damped Newton method for sums of squared distance errors: quadratic where the spectral method crawls.

With n = r/d and share'(e) the slope of an edge, the Hessian block of an edge is

    B = share'' n nᵀ + (share'/d) (I − n nᵀ),

its first term is the Gauss–Newton (Levenberg–Marquardt) matrix; the second is kept too, because an adapted posture
keeps a large residual and Gauss–Newton is slow there. The damping λ makes H + λI positive definite and follows the
ratio of actual to predicted decrease [Nielsen1999]. Coordinates at a face of their box that the gradient pushes
outward are held (projected Newton).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.track import Objective, Status, edge_terms
from robot_retarget.papers.evaluation import box_of, intervals_of, lengths, operator
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.spectral import Minimum

_DENSE = 600
"""Up to this many coordinates the Hessian is factorised as a dense matrix."""


@dataclass(frozen=True)
class Newton:
    """Parameters of the method."""

    value_tolerance: float = 1e-20
    """Stop where σ falls below it."""
    gradient_tolerance: float = 1e-9
    """Stop where the largest component of the projected gradient falls below it."""
    max_iterations: int = 500
    damping: float = 1e-3
    """First λ, relative to the largest diagonal entry of the Hessian."""


def descend(graph: PointGraph, start: Floats, options: Newton, objective: Objective) -> Minimum:
    """Minimise the stress from a start (T, V, K) within the graph's box.

    Args:
        start: (T, V, K) [m].
        options: parameters.
    """
    model = _Model(graph, objective)
    lower, upper = (side.ravel() for side in box_of(graph, start))
    z = np.clip(start.ravel(), lower, upper)
    f, g, blocks = model.evaluate(z)
    damping, growth, history = options.damping * model.largest(blocks), 2.0, [f]
    status = Status.OUT_OF_ITERATIONS
    while len(history) <= options.max_iterations:
        free = ~(((z <= lower) & (g >= 0)) | ((z >= upper) & (g <= 0)))
        if f < options.value_tolerance or np.abs(g[free]).max(initial=0.0) < options.gradient_tolerance:
            status = Status.CONVERGED
            break
        step, damping = model.step(blocks, g, free, damping)
        if np.abs(step).max() < 1e-15 * (1.0 + np.abs(z).max()):
            status = Status.BLOCKED
            break
        trial = np.clip(z + step, lower, upper)
        new = model.evaluate(trial)
        predicted = float(damping * (step @ step) - step @ g) / 2.0
        if new[0] <= f and predicted > 0:
            gain = (f - new[0]) / predicted
            damping, growth = damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), 2.0
            z, (f, g, blocks) = trial, new
        else:
            damping, growth = damping * growth, growth * 2.0
        history.append(f)
    return Minimum(z[:, None], np.array([f]), (status,), (len(history) - 1,), tuple(history))


class _Model:
    """Value, gradient and Hessian of the stress, and the damped step."""

    def __init__(self, graph: PointGraph, objective: Objective):
        self.graph, self.objective = graph, objective
        self.inc, self.bounds = operator(graph), intervals_of(graph.edges)
        self.exact = graph.edges.exact[:, None]
        self.size = graph.frames * len(graph.vertices) * graph.dimension
        self.pattern: tuple[Any, Any] | None = None

    def evaluate(self, z: Floats) -> tuple[float, Floats, tuple[Floats, Floats | None]]:
        r, k = self.inc.differences(z.reshape(-1, self.graph.dimension, 1))
        d = lengths(r)
        target = self.bounds.nearest(d)
        error = d - target
        share, slope, bend = edge_terms(self.objective, error, target, self.bounds.priority, self.bounds.huber_delta)
        bend = np.where((error != 0) | self.exact, bend, 0.0)[:, 0]
        inverse = np.divide(1.0, d, out=np.zeros_like(d), where=d > 0)
        pull = (slope * inverse)[:, 0]
        n = r[:, :, 0] * inverse
        blocks = (bend - pull)[:, None, None] * (n[:, :, None] * n[:, None, :])
        blocks += pull[:, None, None] * np.eye(self.graph.dimension)
        return float(share.sum()), self.inc.gather(n[:, :, None] * slope[:, None], k).ravel(), (blocks, k)

    def largest(self, blocks: tuple[Floats, Floats | None]) -> float:
        """A scale for the damping: the largest diagonal entry of an edge's block, at least 1e-6."""
        return max(float(np.abs(blocks[0]).max(initial=0.0)), 1e-6)

    def step(self, blocks: Any, g: Floats, free: NDArray[np.bool_], damping: float) -> tuple[Floats, float]:
        """−(H + λI)⁻¹ g on the free coordinates, with the λ that made the matrix positive definite."""
        hessian = self._hessian(*blocks)
        step, chosen = np.zeros_like(g), np.flatnonzero(free)
        if chosen.size < self.size:
            hessian = hessian[chosen][:, chosen]
        solver = _dense_step if isinstance(hessian, np.ndarray) else _sparse_step
        step[chosen], damping = solver(hessian, g[chosen], damping)
        return step, damping

    def _hessian(self, blocks: Floats, k: Floats | None) -> Any:
        ids, coefficients = self.inc.members(self.graph.edges, k)
        values = (coefficients[:, :, None] * coefficients[:, None, :])[:, :, None, :, None] * blocks[:, None, :, None]
        row, column = self._places(ids)
        if self.size <= _DENSE:
            flat = np.bincount(row * self.size + column, values.ravel(), self.size * self.size)
            return flat.reshape(self.size, self.size)
        from scipy import sparse  # imported here so that importing the package stays fast

        return sparse.coo_array((values.ravel(), (row, column)), shape=(self.size, self.size)).tocsc()

    def _places(self, ids: Ints) -> tuple[Any, Any]:
        """Row and column of every entry of the (E, m, K, m, K) edge blocks."""
        if self.pattern is None:
            axes = self.graph.dimension
            at = ids[:, :, None] * axes + np.arange(axes)
            shape = (*at.shape, *at.shape[1:])
            row = np.broadcast_to(at[:, :, :, None, None], shape).ravel()
            self.pattern = row, np.broadcast_to(at[:, None, None], shape).ravel()
        return self.pattern


def _dense_step(hessian: Floats, g: Floats, damping: float) -> tuple[Floats, float]:
    from scipy.linalg import get_lapack_funcs  # imported here so that importing the package stays fast

    factorise, substitute = get_lapack_funcs(("potrf", "potrs"), (hessian,))
    diagonal = np.diagonal(hessian).copy()
    while True:
        np.fill_diagonal(hessian, diagonal + damping)
        factor, failed = factorise(hessian, lower=1)
        if not failed:
            return -substitute(factor, g, lower=1)[0], damping
        damping *= 4.0


def _sparse_step(hessian: Any, g: Floats, damping: float) -> tuple[Floats, float]:
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    while True:
        factor = splu(
            (hessian + damping * eye_array(len(g))).tocsc(), diag_pivot_thresh=0.0, permc_spec="MMD_AT_PLUS_A"
        )
        # Without pivoting the signs of the pivots are those of the eigenvalues.
        if (factor.U.diagonal() > 0).all():
            return -factor.solve(g), damping
        damping *= 4.0
