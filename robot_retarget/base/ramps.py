"""Smooth ramps from 0 to 1 in unit time."""

from typing import TypeVar

from robot_retarget.base.arrays import Floats

Values = TypeVar("Values", float, Floats)

JERK_PEAK = 1.875
"""Largest slope of `minimum_jerk` [-]."""
SMOOTHSTEP_PEAK = 1.5
"""Largest slope of `smoothstep` [-]."""


def minimum_jerk(u: Floats) -> Floats:
    """Return 10 u³ − 15 u⁴ + 6 u⁵: zero slope and curvature at both ends."""
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def smoothstep(u: Values) -> Values:
    """Return 3 u² − 2 u³: zero slope at both ends."""
    return u**2 * (3 - 2 * u)
