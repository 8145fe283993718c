"""Costs over several frames on the smooth path of a clip, where all frames move together.

One frame after the other gains little: the others, which stay, hold it by second differences of a weight far above its own. So
the passes leave these costs out of the frames and give them to the path, which solves

    (B + Jᵀ W J) v = −Jᵀ W r,    B = ρ (I + Dᵀ K D) of the smooth path

by conjugate gradients with the preconditioner B: r and J are the residuals of the edges that cost and their slopes at the path.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.sparse.linalg import LinearOperator, cg

from robot_retarget.base.arrays import Floats
from robot_retarget.solver.smooth import SmoothSystem
from robot_retarget.solver.stencils import ClipNeighbours, StencilCost, weighted
from robot_retarget.solver.targets import ClipTargets

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
