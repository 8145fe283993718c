"""Smooth paths near rough ones: second differences in closed form, costs over several frames, speeds of joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import LinearOperator, cg

from robot_retarget.base.arrays import Floats
from robot_retarget.solver.limits import ClipTargets
from robot_retarget.solver.stencils import ClipNeighbours, StencilCost, weighted

DECIMALS = 9
"""Stiffnesses that agree in these decimals share one banded system."""


class SmoothSystem:
    """The matrices I + Dᵀ K D of all columns of a path, D the second difference and K the diagonal of their stiffnesses."""

    stiffness: Floats
    """κ (T − 2, n)."""

    def __init__(self, stiffness: Floats, fixed: int = 0):
        """Factorise the systems of stiffnesses (T, n) without the first `fixed` frames, which stay."""
        self.fixed, self.stiffness = fixed, np.round(stiffness, DECIMALS)[1:-1]
        systems: dict[bytes, list[int]] = {}
        for column, own in enumerate(self.stiffness.T):
            systems.setdefault(own.tobytes(), []).append(column)
        self._factors = [
            (columns, cholesky_banded(_bands(self.stiffness[:, columns[0]])[:, fixed:])) for columns in systems.values()
        ]

    def solved(self, force: Floats) -> Floats:
        """Return the offsets (T, n) whose images are forces (T, n)."""
        offsets = np.zeros_like(force)
        for columns, factor in self._factors:
            offsets[self.fixed :, columns] = cho_solve_banded((factor, False), force[self.fixed :, columns])
        return offsets

    def image(self, offsets: Floats) -> Floats:
        """Return the images (T, n) of offsets (T, n), which are 0 in fixed frames."""
        found = offsets + _pushed(self.stiffness * np.diff(offsets, 2, axis=0))
        found[: self.fixed] = 0.0
        return found

    def offsets(self, speed: Floats, bend: Floats | float) -> Floats:
        """Return the offsets of `smooth_offsets`."""
        shape = len(speed) + 1, speed.shape[1]
        return self.solved(-_pushed(self.stiffness * (np.diff(speed, axis=0) - np.broadcast_to(bend, shape)[1:-1])))


def smooth_offsets(speed: Floats, stiffness: Floats | float, fixed: int = 0, bend: Floats | float = 0.0) -> Floats:
    """Return the offset of each frame that moves second differences towards their targets.

    minimise  Σ_t ‖δ_t‖² + Σ_t κ_t ‖a_t + δ_{t−1} − 2δ_t + δ_{t+1}‖²,   a_t = v_t − v_{t−1} − b_t

    Args:
        speed: (T − 1, n) change from each frame to the next, v.
        stiffness: κ, for all columns, each (n,), or each frame and column (T, n).
        fixed: number of frames at the start that keep δ = 0.
        bend: b, the targets of second differences, for all, each column (n,), or each frame and column (T, n).

    Returns:
        (T, n) offsets δ.
    """
    shape = len(speed) + 1, speed.shape[1]
    if len(speed) < 2:
        return np.zeros(shape)
    return SmoothSystem(np.broadcast_to(stiffness, shape), fixed).offsets(speed, bend)


def _pushed(force: Floats) -> Floats:
    """Return Dᵀ f (T, n) of forces f (T − 2, n) on second differences."""
    pushed = np.zeros((len(force) + 2, force.shape[1]))
    for shift, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
        pushed[shift : shift + len(force)] += factor * force
    return pushed


def _bands(stiffness: Floats) -> Floats:
    """Return the upper bands of I + Dᵀ K D, D the second difference and K the diagonal of the stiffnesses (T − 2,)."""
    frames = len(stiffness) + 2
    diagonals = np.zeros((3, frames))
    for first in range(3):
        for second in range(first, 3):
            values = stiffness * (1.0, -2.0, 1.0)[first] * (1.0, -2.0, 1.0)[second]
            offset = second - first
            diagonals[2 - offset, second : second + frames - 2] += values
    diagonals[2] += 1.0
    return diagonals


# Costs over several frames on the smooth path of a clip, where all frames move together.
#
# One frame after the other gains little: the others, which stay, hold it by second differences of a weight far above its own. So
# the passes leave these costs out of the frames and give them to the path, which solves
#
#     (B + Jᵀ W J) v = −Jᵀ W r,    B = ρ (I + Dᵀ K D) of the smooth path
#
# by conjugate gradients with the preconditioner B: r and J are the residuals of the edges that cost and their slopes at the path.

STEPS = 20
"""Maximum number of steps of conjugate gradients: a pass later, other edges cost."""
RESIDUAL = 1e-2
"""They end at a smaller share of the first residual [-]."""


@dataclass(frozen=True, eq=False)
class JoinedRows:
    """The R edges that cost at a path (T, nq)."""

    slope: csr_array
    """(R, T nv) J."""
    residual: Floats
    weight: Floats
    """(R,) r and the diagonal of W."""


def joined_rows(cost: StencilCost, path: Floats, targets: ClipTargets, seconds: float) -> JoinedRows:
    """Return the edges of a track that cost at a path.

    Args:
        cost: of the track.
        path: (T, nq) configurations.
        targets: of the T frames.
        seconds: time from frame to frame [s].
    """
    stencil, edges, nv = cost.track.stencil, len(cost.track), cost.nv
    every = ClipNeighbours(path, targets, np.arange(len(path)), cost.offsets, seconds)
    _, residual, weight = weighted(cost.track, cost.values(path), cost.sides(every, 0))
    owner, edge = np.nonzero(weight * residual)
    moved = owner[:, None] + np.array(stencil)
    frames, place = np.unique(moved, return_inverse=True)
    _, slope = cost.rows(path[frames], every.of(frames))
    data = slope.reshape(-1, len(stencil), edges, nv)[
        place.reshape(moved.shape), np.arange(len(stencil)), edge[:, None]
    ]
    columns = nv * moved[..., None] + np.arange(nv)
    starts = len(stencil) * nv * np.arange(len(owner) + 1)
    jacobian = csr_array((data.ravel(), columns.ravel(), starts), shape=(len(owner), nv * len(path)))
    return JoinedRows(jacobian, residual[owner, edge], weight[owner, edge])


def joined_offsets(rows: Sequence[JoinedRows], system: SmoothSystem, rho: Floats, shape: tuple[int, int]) -> Floats:
    """Return the offsets (T, nv) of the path towards the minimum of its smoothness and of the edges that cost.

    Args:
        rows: of every cost.
        system: of the smooth path, over ρ.
        rho: (nv,) ρ.
        shape: T and nv.
    """
    slope = vstack([each.slope for each in rows])
    weight = np.concatenate([each.weight for each in rows])
    force = -slope.T @ (weight * np.concatenate([each.residual for each in rows]))
    free = np.repeat(np.arange(shape[0]) >= system.fixed, shape[1])

    def image(offset: Floats) -> Floats:
        smooth = rho * system.image(offset.reshape(shape))
        return smooth.ravel() + free * (slope.T @ (weight * (slope @ offset)))

    def nearest(image: Floats) -> Floats:
        return system.solved(image.reshape(shape) / rho).ravel()

    square = force.size, force.size
    matrix, inverse = (
        LinearOperator(square, matvec=each, dtype=float)  # pyright: ignore[reportCallIssue]
        for each in (image, nearest)
    )
    return cg(matrix, free * force, rtol=RESIDUAL, maxiter=STEPS, M=inverse)[0].reshape(shape)


def within_speeds(angles: Floats, reach: Floats, fixed: int = 0) -> Floats:
    """Return (T, n) angles that change by at most `reach` per frame; a path that does so already stays unchanged.

    The result is halfway between the highest such path below the angles and the lowest above them: both keep the
    speeds, and so does their mean. The first `fixed` frames stay, and the frames after them are limited to angles
    within reach of them.

    Args:
        angles: (T, n) [rad].
        reach: (n,) or (T − 1, n) largest change from a frame to the next [rad].
        fixed: number of first frames that stay unchanged.
    """
    reach = np.broadcast_to(reach, (max(len(angles) - 1, 0), angles.shape[1]))
    over, under = _bounded(angles, reach, np.maximum), _bounded(angles, reach, np.minimum)
    path = (over + under) / 2
    if fixed:
        path[:fixed] = angles[:fixed]
        room = np.cumsum(reach[fixed - 1 :], axis=0)
        path[fixed:] = np.clip(path[fixed:], angles[fixed - 1] - room, angles[fixed - 1] + room)
    return path


def _bounded(angles: Floats, reach: Floats, extreme: np.ufunc) -> Floats:
    """Return the lowest path over the angles, or the highest under them, that changes by at most `reach` per frame."""
    path, way = angles.copy(), -reach if extreme is np.maximum else reach
    for t in range(1, len(path)):
        path[t] = extreme(path[t], path[t - 1] + way[t - 1])
    for t in range(len(path) - 2, -1, -1):
        path[t] = extreme(path[t], path[t + 1] + way[t])
    return path
