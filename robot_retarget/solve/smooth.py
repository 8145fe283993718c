"""The smooth path nearest to a rough one, in closed form: one banded system for all joints."""

import numpy as np
from scipy.linalg import solveh_banded

from robot_retarget.arrays import Floats

DECIMALS = 9
"""Stiffnesses that agree in these decimals share one banded system."""


def smooth_offsets(speed: Floats, stiffness: Floats | float, fixed: int = 0) -> Floats:
    """Return the offset of each frame that reduces second differences.

    minimise  Σ_t ‖δ_t‖² + κ Σ_t ‖a_t + δ_{t−1} − 2δ_t + δ_{t+1}‖²,   a_t = v_t − v_{t−1}

    Args:
        speed: (T − 1, n) change from each frame to the next, v.
        stiffness: κ, for all columns or each (n,).
        fixed: number of frames at the start that keep δ = 0.

    Returns:
        (T, n) offsets δ.
    """
    frames = len(speed) + 1
    if frames < 3:
        return np.zeros((frames, speed.shape[1]))
    bend = np.diff(speed, axis=0)
    pushed = np.zeros((frames, speed.shape[1]))
    for shift, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
        pushed[shift : shift + len(bend)] += factor * bend
    offsets, rounded = np.zeros_like(pushed), np.round(np.broadcast_to(stiffness, bend.shape[1:]), DECIMALS)
    for kappa in np.unique(rounded):
        columns = np.flatnonzero(rounded == kappa)
        right = -kappa * pushed[fixed:, columns]
        offsets[fixed:, columns] = solveh_banded(_bands(frames, float(kappa))[:, fixed:], right)
    return offsets


def _bands(frames: int, stiffness: float) -> Floats:
    """Return the upper bands of I + κ DᵀD, D the second difference."""
    diagonals = np.zeros((3, frames))
    for first in range(3):
        for second in range(first, 3):
            values = stiffness * (1.0, -2.0, 1.0)[first] * (1.0, -2.0, 1.0)[second]
            offset = second - first
            diagonals[2 - offset, second : second + frames - 2] += values
    diagonals[2] += 1.0
    return diagonals
