"""Smooth paths near rough ones: second differences in closed form, and speeds of joints."""

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from robot_retarget.base.arrays import Floats

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
