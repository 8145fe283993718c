"""Smooth paths near rough ones: second and third differences in closed form, and speeds of joints."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.track import THIRD_DIFFERENCE

DECIMALS = 9
"""Stiffnesses that agree in these decimals, but for rounding, share one banded system."""
HIGHEST = len(THIRD_DIFFERENCE) - 1
"""Order of the differences that are smooth: those of the jerk."""


def smooth_offsets(
    speed: Floats, stiffness: Floats | float, fixed: int = 0, bend: Floats | float = 0.0, jerk: Floats | float = 0.0
) -> Floats:
    """Return the offset of each frame that moves second differences towards their targets, and third ones towards 0.

    minimise  Σ_t ‖δ_t‖² + Σ_t κ_t ‖a_t + Δ²δ_t‖² + Σ_t λ_t ‖Δ²v_t + Δ³δ_t‖²,   a_t = v_t − v_{t−1} − b_t

    Args:
        speed: (T − 1, n) change from each frame to the next, v.
        stiffness: κ, for all columns, each (n,), or each frame and column (T, n).
        fixed: number of frames at the start that keep δ = 0.
        bend: b, the targets of second differences, for all, each column (n,), or each frame and column (T, n).
        jerk: λ, as κ.

    Returns:
        (T, n) offsets δ.
    """
    shape = len(speed) + 1, speed.shape[1]
    offsets = np.zeros(shape)
    if len(speed) < 2:
        return offsets
    rows = [_Rows.of(k, own, speed, target) for k, own, target in ((2, stiffness, bend), (3, jerk, 0.0))]
    force = -np.sum([each.pushed(shape) for each in rows], axis=0)
    for columns in _alike(rows):
        bands = np.sum([each.bands(columns[0], shape[0]) for each in rows], axis=0)
        bands[-1] += 1.0
        factor = cholesky_banded(bands[:, fixed:])
        offsets[fixed:, columns] = cho_solve_banded((factor, False), force[fixed:, columns])
    return offsets


@dataclass(frozen=True, eq=False)
class _Rows:
    """The differences of one order that are smooth: K, and what they miss at δ = 0."""

    factors: Floats
    """Of the frames in a difference."""
    stiffness: Floats
    missed: Floats
    """(T − k, n)."""

    @classmethod
    def of(cls, order: int, stiffness: Floats | float, speed: Floats, target: Floats | float) -> "_Rows":
        shape, change = (len(speed) + 1, speed.shape[1]), np.diff(speed, order - 1, axis=0)
        own, wanted = (np.broadcast_to(each, shape)[1 : 1 + len(change)] for each in (stiffness, target))
        return cls(np.diff(np.eye(order + 1), order, axis=0)[0], own.round(DECIMALS), change - wanted)

    def pushed(self, shape: tuple[int, int]) -> Floats:
        """Return Dᵀ K d (T, n) of the misses d."""
        pushed = np.zeros(shape)
        for shift, factor in enumerate(self.factors):
            pushed[shift : shift + len(self.missed)] += factor * (self.stiffness * self.missed)
        return pushed

    def bands(self, column: int, frames: int) -> Floats:
        """Return the upper bands (4, T) of Dᵀ K D of a column."""
        bands, own = np.zeros((HIGHEST + 1, frames)), self.stiffness[:, column]
        for first, second in combinations_with_replacement(range(len(self.factors)), 2):
            products = self.factors[first] * self.factors[second] * own
            bands[HIGHEST - second + first, second : second + len(own)] += products
        return bands


def _alike(rows: Sequence[_Rows]) -> list[list[int]]:
    """Return the columns that share one banded system, together."""
    systems: dict[bytes, list[int]] = {}
    for column in range(rows[0].stiffness.shape[1]):
        systems.setdefault(b"".join(each.stiffness[:, column].tobytes() for each in rows), []).append(column)
    return [*systems.values()]


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
