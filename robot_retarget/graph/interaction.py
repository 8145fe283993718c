"""The interaction distance of [Mucherino2019, §4]: how close two joints come if both keep their last step.

With c = p_v^t − p_u^t, s = p^t − p^(t−1) the last steps and w = s_v − s_u, the distance at α = 1 + k steps after frame
t − 1 is ‖c + k w‖. Its square is a convex parabola in k, so the minimum over k = 0, 1, 2, … is at

    k = max(0, ⌈−c·w / w·w − ½⌉),    k = 0 where ‖w‖ ≤ dead band,    k ≤ horizon,
    α = 1 + k,    D = ‖c + k w‖.

A steady joint has step 0 and two co-moving joints have w = 0, so the three cases of Definition 12 (and the mirror case
that it omits) are this one expression. Two points at rest have rounding noise for w, and k = c/noise makes D
meaningless. The dead band treats such pairs as co-moving, and the horizon bounds k. Horizon ∞ and dead band 0 give the
exact definition of the paper.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import GraphError, UsageError

DEAD_BAND = 1e-9
"""Relative steps up to this length are rest [m]: above rounding at the size of a body, far below any sensor."""

_FRAMES_AT_ONCE = 256
"""Number of frames per block: the working arrays of 22 joints stay in the processor's cache."""
_FEW_FRAMES = 8
"""Up to this number of frames, the pairs are gathered in one operation. Measured: 1.8 in place of 8.1 ms for 4 frames of 20
points, 10.7 in place of 9.1 ms for 32."""
_FARTHEST = float(2**53)
"""The largest k that a float64 represents exactly."""


@dataclass(frozen=True)
class Interaction:
    """Options of the interaction distance.

    Raises:
        UsageError: a negative or NaN option.
    """

    horizon: float | None = None
    """Steps ahead that count, k ≤ horizon; None is the paper's ∞. Half a second (0.5 · fps) suits motion capture."""
    dead_band: float = DEAD_BAND
    """Relative steps up to this length are rest [m]; the jitter of the source suits motion capture."""
    continuous: bool = False
    """k over the non-negative reals: the distance of a point to a ray, 0 ≤ D − D_continuous ≤ ‖w‖ / 2."""

    def __post_init__(self) -> None:
        if self.horizon is not None and not self.horizon >= 0:
            raise UsageError(f"horizon must be None or ≥ 0 steps, got {self.horizon}")
        if not self.dead_band >= 0:
            raise UsageError(f"dead_band must be ≥ 0 m, got {self.dead_band}")

    @property
    def farthest(self) -> float:
        """The largest k."""
        return _FARTHEST if self.horizon is None else min(self.horizon, _FARTHEST)


def steps_ahead(separation_step: Floats, step_step: Floats, options: Interaction) -> Floats:
    """k from c·w and w·w; non-negative, an integer unless the options ask for the continuous relaxation.

    Args:
        separation_step: c·w of any shape [m²].
        step_step: w·w of the same shape [m²].
        options: horizon, dead band and relaxation.
    """
    band = options.dead_band**2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        best = -separation_step / step_step
    best = best if options.continuous else np.ceil(best - 0.5)
    farthest = options.farthest if options.continuous else np.floor(options.farthest)
    return np.where((step_step <= band) | ~(best > 0), 0.0, np.minimum(best, farthest))


def interaction_distance(
    previous: ArrayLike, current: ArrayLike, *, horizon: float | None = None, dead_band: float = DEAD_BAND
) -> tuple[Floats, Ints]:
    """D and α of every pair of joints, [Mucherino2019, Definition 12] by the closed form of this module.

    Args:
        previous: positions at frame t − 1, (…, K, n) [m].
        current: positions at frame t, the same shape [m].
        horizon: steps ahead that count, α ≤ 1 + horizon; None is unbounded, as in the paper.
        dead_band: relative steps up to this length are rest [m].

    Returns:
        D (…, K(K−1)/2) [m] and α (…, K(K−1)/2) in steps from frame t − 1, over the pairs of
        `numpy.triu_indices(K, 1)`. The closest approach is α − 1 frames from now.

    Raises:
        GraphError: the shapes differ, have fewer than two axes, or a coordinate is not finite (the joint is named).
        UsageError: a negative option.
    """
    before, now = np.asarray(previous, dtype=np.float64), np.asarray(current, dtype=np.float64)
    if before.shape != now.shape or now.ndim < 2:
        raise GraphError(f"previous and current must both be (…, joints, coordinates): {before.shape}, {now.shape}")
    for name, positions in (("previous", before), ("current", now)):
        lost = np.argwhere(~np.isfinite(positions))
        if lost.size:
            raise GraphError(f"{name} is not finite at joint {lost[0][-2]}, index {tuple(map(int, lost[0]))}")
    options = Interaction(horizon, dead_band)
    lead, (joints, axes) = now.shape[:-2], now.shape[-2:]
    pairs = joints * (joints - 1) // 2
    before, now = before.reshape(-1, joints, axes), now.reshape(-1, joints, axes)
    if len(now) <= _FEW_FRAMES:
        u, v = np.triu_indices(joints, 1)
        step = now - before
        distance, alpha = pair_interaction(now[:, v] - now[:, u], step[:, v] - step[:, u], options)
        return distance.reshape(*lead, pairs), alpha.astype(np.int64).reshape(*lead, pairs)
    distance, alpha = np.empty((len(now), pairs)), np.empty((len(now), pairs), dtype=np.int64)
    for start in range(0, len(now), _FRAMES_AT_ONCE):
        block = slice(start, start + _FRAMES_AT_ONCE)
        _fill(before[block], now[block], options, distance[block], alpha[block])
    return distance.reshape(*lead, pairs), alpha.reshape(*lead, pairs)


def _fill(before: Floats, now: Floats, options: Interaction, distance: Floats, alpha: Ints) -> None:
    """One block of frames, coordinate by coordinate with the frames contiguous, one row of pairs per joint."""
    position = np.ascontiguousarray(now.transpose(2, 1, 0))  # (axes, joints, frames)
    step = position - before.transpose(2, 1, 0)
    ahead, squared = np.empty(distance.T.shape), np.empty(distance.T.shape)
    first = 0
    for joint in range(position.shape[1] - 1):
        last = first + position.shape[1] - 1 - joint
        c = position[:, joint + 1 :] - position[:, joint, None]
        w = step[:, joint + 1 :] - step[:, joint, None]
        k = steps_ahead(np.einsum("apf,apf->pf", c, w), np.einsum("apf,apf->pf", w, w), options)
        w *= k
        w += c
        np.einsum("apf,apf->pf", w, w, out=squared[first:last])
        ahead[first:last] = k
        first = last
    distance[...] = np.sqrt(squared, out=squared).T
    ahead += 1.0
    alpha[...] = ahead.T


def pair_interaction(
    separation: Floats, relative_step: Floats, options: Interaction | None = None
) -> tuple[Floats, Floats]:
    """D and α of pairs given by c (…, K) [m] and w (…, K) [m]; α is real under the continuous relaxation.

    Args:
        separation: c (…, K) [m].
        relative_step: w (…, K) [m].
    """
    options = options or Interaction()
    product, square = (separation * relative_step).sum(-1), (relative_step**2).sum(-1)
    k = steps_ahead(product, square, options)
    return np.linalg.norm(separation + k[..., None] * relative_step, axis=-1), 1.0 + k
