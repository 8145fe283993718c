"""The nearest motion that a servo can follow: its torque stays within the bound over the whole clip.

    minimise ½ ‖y‖²   subject to   −b − τ ≤ A y ≤ b − τ,      A = J D₂ + d D₁

for the change y of one joint's angles over all samples; τ is the torque of the given motion, A y the torque added by the
change. A servo at its limit then starts early and arrives late, instead of late only.
"""

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from robot_retarget.base.arrays import Floats

ROUNDS = 400
"""Of the alternating directions; each is two banded multiplications and one banded solution."""
PENALTY = 2e-3
"""Of the alternating directions [rad²/(N m)²]: the square of the compliance of a joint of 20 N m/rad."""
ENOUGH = 1e-5
"""A change that alters less from round to round is found [rad]."""


def torque_limited_reference(torque: Floats, bound: float, inertia: float, damping: float, dt: float) -> Floats:
    """The change (N,) [rad] of a joint's motion that keeps its torque (N,) [N m] within ± `bound`, at best; 0 at both ends.

    Args:
        inertia: J, inertia at the joint [kg m²].
        damping: d [N m s/rad].
        dt: from sample to sample [s].
    """
    count = len(torque)
    if count < 5 or np.abs(torque).max() <= bound:
        return np.zeros(count)
    before, here, after = (
        inertia / dt**2 - damping / (2 * dt),
        -2 * inertia / dt**2,
        inertia / dt**2 + damping / (2 * dt),
    )

    def add(change: Floats) -> Floats:
        padded = np.pad(change, 1)
        return before * padded[:-2] + here * change + after * padded[2:]

    def back(force: Floats) -> Floats:
        padded = np.pad(force, 1)
        return before * padded[2:] + here * force + after * padded[:-2]

    factor = (cholesky_banded(_normal(before, here, after, count), lower=True), True)
    least, most = -bound - torque, bound - torque
    change, dual = np.zeros(count), np.zeros(count)
    allowed = np.clip(0.0, least, most)
    for _ in range(ROUNDS):
        last = change
        change = cho_solve_banded(factor, PENALTY * back(allowed - dual))
        added = 1.6 * add(change) - 0.6 * allowed
        allowed = np.clip(added + dual, least, most)
        dual += added - allowed
        if np.abs(change - last).max() < ENOUGH:
            break
    return change


def _normal(before: float, here: float, after: float, count: int) -> Floats:
    """I + ρ AᵀA as lower bands, the corners as in the middle: both ends are at rest anyway."""
    bands = np.zeros((3, count))
    bands[0] = 1 + PENALTY * (before**2 + here**2 + after**2)
    bands[1] = PENALTY * (before * here + here * after)
    bands[2] = PENALTY * before * after
    return bands
