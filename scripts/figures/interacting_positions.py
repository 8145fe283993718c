"""Where a joint may go next when its interaction distances are prescribed, [Mucherino2019, §4 and Fig. 3].

For the unknown position p = p_v^t the constraint at α reads ‖p − c_α‖ = D̂/α with

    c_α = p_v^(t−1) + (p(u, α) − p_v^(t−1)) / α,    p(u, α) = p_u^(t−1) + α (p_u^t − p_u^(t−1)),

so D(u, v) < D̂ exactly where p lies inside one of these balls: the velocity obstacle of robotics, in discrete time.
The set Π of the paper is the boundary of their union. Each constraint has its own α; the paper's "same α for every
semi-straight line" is a special case.
"""

from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError
from robot_retarget.graph.interaction import Interaction, pair_interaction
from robot_retarget.papers.branch import intersect


def feasible_balls(
    previous: ArrayLike, current: ArrayLike, start: ArrayLike, distance: float, horizon: int
) -> tuple[Floats, Floats]:
    """The balls of p_v^t with D(u, v) < D̂: centres (A, K) and radii (A,) for α = 1 … A = 1 + horizon [m].

    Args:
        previous: p_u^(t−1), (K,) [m].
        current: p_u^t, (K,) [m].
        start: p_v^(t−1), (K,) [m].
        distance: D̂ [m].
        horizon: steps ahead that count.
    """
    before, now, origin = (np.asarray(point, dtype=np.float64) for point in (previous, current, start))
    alpha = np.arange(1.0, horizon + 2.0)[:, None]
    ahead = before + alpha * (now - before)
    return origin + (ahead - origin) / alpha, distance / alpha[:, 0]


def interacting_positions(
    previous: ArrayLike,
    current: ArrayLike,
    start: ArrayLike,
    distances: ArrayLike,
    *,
    horizon: int = 30,
    equal: bool = False,
    tolerance: float = 1e-8,
) -> tuple[Floats, Floats]:
    """Every p_v^t with D(u_m, v) = D̂_m for K joints u_m in dimension K, over all (α_1, …, α_K).

    Args:
        previous: (K, K) positions of the joints u_m at t − 1 [m].
        current: (K, K) their positions at t [m].
        start: p_v^(t−1), (K,) [m].
        distances: D̂ (K,) [m].
        horizon: steps ahead that count, α ≤ 1 + horizon.
        equal: only α_1 = … = α_K, the reading of the paper.
        tolerance: how far a solution may miss a distance [m].

    Returns:
        The positions (S, K) [m] and their α (S, K).

    Raises:
        GraphError: the number of constraints is not the dimension.
    """
    before, now = np.asarray(previous, dtype=np.float64), np.asarray(current, dtype=np.float64)
    origin, wanted = np.asarray(start, dtype=np.float64), np.asarray(distances, dtype=np.float64)
    axes = len(origin)
    if before.shape != (axes, axes) or now.shape != (axes, axes) or wanted.shape != (axes,):
        raise GraphError(f"{axes} constraints are needed in dimension {axes}: {before.shape=}, {wanted.shape=}")
    choices = range(horizon + 1)
    picked = np.array([(k,) * axes for k in choices] if equal else list(product(choices, repeat=axes)))
    balls = [feasible_balls(before[m], now[m], origin, wanted[m], horizon) for m in range(axes)]
    centres = np.stack([ball[0][picked[:, m]] for m, ball in enumerate(balls)], axis=1)
    radii = np.stack([ball[1][picked[:, m]] for m, ball in enumerate(balls)], axis=1)
    points = intersect(centres, radii).reshape(-1, axes)
    alphas = np.tile(picked + 1, (2, 1))
    found = np.isfinite(points).all(axis=1)
    points, alphas = points[found], alphas[found]
    step = (points - origin)[:, None] - (now - before)
    reached, reached_alpha = pair_interaction(points[:, None] - now, step, Interaction(horizon, 0.0))
    good = (np.abs(reached - wanted) <= tolerance).all(axis=1)
    if equal:
        good &= (reached_alpha == alphas).all(axis=1)
    return _distinct(points[good], reached_alpha[good], tolerance)


def _distinct(points: Floats, alphas: Floats, tolerance: float) -> tuple[Floats, Floats]:
    kept: list[int] = []
    for index, point in enumerate(points):
        if all(np.abs(point - points[other]).max() > tolerance for other in kept):
            kept.append(index)
    return points[kept], alphas[kept]
