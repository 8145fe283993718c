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

from robot_retarget.arrays import Floats
from robot_retarget.solve.smooth import SmoothSystem
from robot_retarget.solve.stencils import ClipNeighbours, StencilCost, weighted
from robot_retarget.solve.targets import ClipTargets

STEPS = 20
"""Maximum number of steps of conjugate gradients: a pass later, other edges cost."""
GAIN = 1e-3
"""They end when a step gains a smaller share of the first one's gain [-]."""


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
    offset, force = np.zeros(shape), force.reshape(shape)
    way = drawn = system.solved(force / rho)
    pushed, gain = force, float((force * drawn).sum())  # B way, and the gain of the step
    least = GAIN * gain
    for _ in range(STEPS):
        if gain <= least:
            break
        change = slope @ way.ravel()
        image = pushed + (slope.T @ (weight * change)).reshape(shape)
        step = gain / float((way * image).sum())
        offset, force = offset + step * way, force - step * image
        drawn, before = system.solved(force / rho), gain
        gain = float((force * drawn).sum())
        way, pushed = drawn + gain / before * way, force + gain / before * pushed
    return offset
