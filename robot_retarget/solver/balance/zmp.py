"""A path of the centre of mass over a clip, planned with preview: one quadratic program over all frames.

    minimise  Σ ‖c_t − c⁰_t‖² + j Σ ‖c_{t+3} − 3c_{t+2} + 3c_{t+1} − c_t‖² (rate)⁶ + penalty Σ s_t²
    subject to  A_t c_t ≤ b_t + s_t   (static)      A_t (c_t − (z_t/g) c̈_t) ≤ b_t + s_t   (zero moment point)

with the support polygons {x : A_t x ≤ b_t} shrunk towards their middles. Every frame uses the supports of all later
frames, so weight is shifted before a foot lifts.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from scipy import sparse

from robot_retarget.base.arrays import Floats
from robot_retarget.robot.support import Polygon


@dataclass(frozen=True)
class Steadiness:
    """Options of the plan of the centre of mass."""

    keep: float = 0.55
    """Usable share of the support polygon, shrunk towards its middle."""
    static: bool = True
    """Whether the centre of mass itself stays inside, not only the zero moment point."""
    jerk: float = 1e-4
    """Weight of the squared third derivative [s⁶]."""
    pull: float = 1.0
    """Weight of the target path."""
    penalty: float = 1e5
    """Weight of the squared excess over the polygon."""


@dataclass(frozen=True)
class ZmpPlan:
    """A planned path."""

    centre: Floats
    """(T, 2) path of the centre of mass [m]."""
    excess: Floats
    """(T,) distance outside the shrunk polygons [m]."""


def plan_centre(targets: Floats, lever: Floats, supports: list[Polygon], fps: float, how: Steadiness) -> ZmpPlan:
    """Plan the path of the centre of mass by the quadratic program of this module.

    Args:
        targets: (T, 2) target path c⁰ [m].
        lever: (T,) height z of the centre of mass over the floor, over gravity g [s²].
        supports: T support polygons.
        fps: frames per second [1/s].
        how: weights of the program, and whether the centre of mass itself stays in the polygons.

    Returns:
        The path, and the distance by which each frame exceeds its polygon.
    """
    count = len(targets)
    acceleration = _second(count) * fps**2
    point = sparse.eye(count) - sparse.diags(lever) @ acceleration
    kinds = [sparse.eye(count), point] if how.static else [point]
    shrunk = [polygon.shrunk(how.keep) for polygon in supports]
    rows, least = zip(*[_inside(shrunk, take) for take in kinds], strict=True)
    third = _third(count) * fps**3
    smooth = how.jerk * (third.T @ third) + how.pull * sparse.eye(count)
    hessian = 2 * sparse.block_diag([smooth, smooth, how.penalty * sparse.eye(count)], format="csc")
    gradient = np.concatenate([-2 * how.pull * targets[:, 0], -2 * how.pull * targets[:, 1], np.zeros(count)])
    found = _solve(hessian, gradient, sparse.vstack(rows, format="csc"), np.concatenate(least))
    return ZmpPlan(found[: 2 * count].reshape(2, count).T, np.maximum(found[2 * count :], 0.0))


def _inside(supports: list[Polygon], take: Any) -> tuple[Any, Floats]:
    """Return rows (c_x, c_y, s) ↦ A_t (take c)_t − s_t ≤ b_t of all frames, and their bounds."""
    frames = np.concatenate([np.full(len(p.bounds), t) for t, p in enumerate(supports)])
    normals, bounds = np.concatenate([p.normals for p in supports]), np.concatenate([p.bounds for p in supports])
    pick = sparse.csr_matrix((np.ones(len(frames)), (np.arange(len(frames)), frames)), (len(frames), len(supports)))
    taken = pick @ take
    rows = sparse.hstack([sparse.diags(normals[:, 0]) @ taken, sparse.diags(normals[:, 1]) @ taken, -pick])
    return rows, bounds


def _solve(h: Any, g: Floats, a: Any, upper: Floats) -> Floats:
    """minimise ½ xᵀHx + gᵀx subject to A x ≤ upper, by OSQP's operator splitting."""
    shape = {"h": _sparsity(h), "a": _sparsity(a)}
    precise = {"eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 20000, "verbose": False}
    solver = ca.conic("plan", "osqp", shape, {"error_on_fail": False, "osqp": precise})
    sides = {"lba": -np.inf, "uba": upper, "lbx": -np.inf, "ubx": np.inf}
    return solver(h=_matrix(h), g=g, a=_matrix(a), **sides)["x"].full().ravel()


def _columns(matrix: Any) -> Any:
    columns = sparse.csc_matrix(matrix)
    columns.sort_indices()
    return columns


def _sparsity(matrix: Any) -> ca.Sparsity:
    columns, (rows, width) = _columns(matrix), matrix.shape
    return ca.Sparsity(rows, width, columns.indptr.tolist(), columns.indices.tolist())


def _matrix(matrix: Any) -> ca.DM:
    return ca.DM(_sparsity(matrix), _columns(matrix).data)


def _bands(values: list[float], first: int, shape: tuple[int, int]) -> Any:
    """Return a matrix with constant values on the diagonals from `first` on."""
    diagonals: Any = range(first, first + len(values))
    return sparse.diags(values, diagonals, shape)


def _second(count: int) -> Any:
    """Return second differences; at rest before the first frame and after the last."""
    matrix = _bands([1.0, -2.0, 1.0], -1, (count, count)).tolil()
    matrix[0, 0] = matrix[count - 1, count - 1] = -1.0
    return matrix.tocsr()


@cache
def _third(count: int) -> Any:
    return _bands([-1.0, 3.0, -3.0, 1.0], 0, (max(count - 3, 0), count)).tocsr()
