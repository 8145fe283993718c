"""Steps within the reach of short legs: the place of each foothold relative to the other foot's stance.

A robot on bent knees and flat soles reaches less far than a human who rolls over heel and toes. The robot's own stand
defines the place of each foot relative to the other. A foothold too far from that place moves nearer, and all later
footholds move by the same amount, so steps within reach stay unchanged.
"""

import numpy as np

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.solver.balance.foot_spacing import ahead

REACH = 0.35
"""Largest distance of a foothold from its place next to the other foot, over the leg length."""


def reachable_footholds(planted: np.ndarray, corners: Floats, own: Floats, leg: float, reach: float = REACH) -> Floats:
    """Return (T, 2, 4, 3) soles with footholds within reach of each other.

    Args:
        planted: (T, 2), at least one foot at every frame, both during a transfer of weight.
        corners: (T, 2, 4, 3) target corners of the soles [m].
        own: (2, 4, 3) corners in the robot's own stand [m].
    """
    middle, beside = corners.mean(axis=2)[..., :2], _complex((own[1] - own[0]).mean(axis=0)[:2])
    place = beside * _complex(ahead(corners)) / _complex(ahead(own[None]))
    places = np.stack([-place, place], axis=1)
    moved = _moved(planted, _complex(middle), places, reach * leg)
    placed = corners.copy()
    placed[..., 0] += np.real(moved)[:, :, None]
    placed[..., 1] += np.imag(moved)[:, :, None]
    return placed


def _moved(planted: np.ndarray, middle: np.ndarray, places: np.ndarray, reach: float) -> np.ndarray:
    """Return (T, 2) shifts of the soles as complex numbers; each has its place (T, 2) relative to the other."""
    moved = np.zeros_like(middle)
    stances = sorted((start, foot, stop) for foot in range(2) for start, stop in intervals(planted[:, foot]))
    for start, foot, stop in stances[1:]:
        other = _stance(planted[:, 1 - foot], start)
        apart = _median(middle[start:stop, foot]) - _median(middle[other, 1 - foot])
        beyond = _beyond(apart - places[start, foot], reach)
        moved[start:stop, foot] = moved[other.start, 1 - foot] - beyond
    for foot in np.flatnonzero(planted.any(axis=0)):
        air, known = np.flatnonzero(~planted[:, foot]), np.flatnonzero(planted[:, foot])
        moved[air, foot] = np.interp(air, known, moved[known, foot])
        apart = (middle + moved)[air, foot] - (middle + moved)[air, 1 - foot]
        moved[air, foot] -= _beyond(apart - places[air, foot], reach)
    return moved


def _beyond(apart: np.ndarray, reach: float) -> np.ndarray:
    """Return the excess of complex numbers over their largest length."""
    return apart * (1 - np.minimum(1.0, reach / np.maximum(np.abs(apart), 1e-9)))


def total_step_length(planted: np.ndarray, corners: Floats) -> float:
    """Return the summed length of the steps of all feet [m].

    Args:
        planted: (T, F) feet on the floor.
        corners: (T, F, 4, 3) of the soles [m].
    """
    middle, total = corners.mean(axis=2)[..., :2], 0.0
    for foot in range(planted.shape[1]):
        stances = [np.median(middle[start:stop, foot], axis=0) for start, stop in intervals(planted[:, foot])]
        total += float(np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()) if len(stances) > 1 else 0.0
    return total


def _stance(planted: np.ndarray, frame: int) -> slice:
    """Return the stance of a foot at a frame or the one before it."""
    return next(slice(*span) for span in intervals(planted) if span[0] <= frame <= span[1])


def _complex(flat: Floats) -> np.ndarray:
    """Return points (…, 2) of the floor as complex numbers, so that multiplication rotates them."""
    return flat[..., 0] + 1j * flat[..., 1]


def _median(places: np.ndarray) -> complex:
    """Return the median of complex numbers, axis by axis."""
    return complex(np.median(np.real(places)), np.median(np.imag(places)))
