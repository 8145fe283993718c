"""The smooth path nearest to a rough one, in closed form: one banded system for all joints."""

import numpy as np
from scipy.linalg import solveh_banded

from robot_retarget.arrays import Floats

DECIMALS = 9
"""Stiffnesses that agree in these decimals share one banded system."""


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
    frames = len(speed) + 1
    if frames < 3:
        return np.zeros((frames, speed.shape[1]))
    shape = frames, speed.shape[1]
    kappa: Floats = np.broadcast_to(np.round(stiffness, DECIMALS), shape)[1:-1]
    force, pushed = kappa * (np.diff(speed, axis=0) - np.broadcast_to(bend, shape)[1:-1]), np.zeros(shape)
    for shift, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
        pushed[shift : shift + len(force)] += factor * force
    offsets = np.zeros_like(pushed)
    systems: dict[bytes, list[int]] = {}
    for column, own in enumerate(kappa.T):
        systems.setdefault(own.tobytes(), []).append(column)
    for columns in systems.values():
        offsets[fixed:, columns] = solveh_banded(_bands(kappa[:, columns[0]])[:, fixed:], -pushed[fixed:, columns])
    return offsets


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
