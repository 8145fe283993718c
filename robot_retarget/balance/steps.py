"""Steps that short legs can follow: where each foot is set down, seen from the other one that stands.

A robot that stands on bent knees and flat soles reaches less far than a human who rolls over heel and toes. A foot that
is set down too far from where it stands beside the other in the robot's own stand is set down nearer; all that comes
after goes along, so that steps within reach stay as they are.
"""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.soles import lengths
from robot_retarget.motion.stance import intervals

REACH = 0.35
"""How far a foot is set from its place beside the other, over the leg length."""


def within_reach(planted: np.ndarray, corners: Floats, own: Floats, leg: float, reach: float = REACH) -> Floats:
    """(T, 2, 4, 3) soles whose footholds are within reach of each other.

    Args:
        planted: (T, 2), at least one foot at every frame, both where weight goes across.
        corners: (T, 2, 4, 3) of the soles as they are wished [m].
        own: (2, 4, 3) of the robot's own stand [m].
    """
    middle, beside = corners.mean(axis=2)[..., :2], _complex((own[1] - own[0]).mean(axis=0)[:2])
    place = beside * _turns(corners) / _turns(own[None])
    places = np.stack([-place, place], axis=1)
    moved = _moved(planted, _complex(middle), places, reach * leg)
    placed = corners.copy()
    placed[..., 0] += np.real(moved)[:, :, None]
    placed[..., 1] += np.imag(moved)[:, :, None]
    return placed


def _moved(planted: np.ndarray, middle: np.ndarray, places: np.ndarray, reach: float) -> np.ndarray:
    """(T, 2) by how much the soles are moved, as complex numbers; each has its place (T, 2) beside the other."""
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
    """What complex numbers are longer than they may be."""
    return apart * (1 - np.minimum(1.0, reach / np.maximum(np.abs(apart), 1e-9)))


def carried(planted: np.ndarray, corners: Floats) -> float:
    """How far all steps together carry the feet [m]."""
    middle, total = corners.mean(axis=2)[..., :2], 0.0
    for foot in range(planted.shape[1]):
        stances = [np.median(middle[start:stop, foot], axis=0) for start, stop in intervals(planted[:, foot])]
        total += float(np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()) if len(stances) > 1 else 0.0
    return total


def _stance(planted: np.ndarray, frame: int) -> slice:
    """The stance of a foot at a frame or the one before it."""
    return next(slice(*span) for span in intervals(planted) if span[0] <= frame <= span[1])


def _turns(corners: Floats) -> np.ndarray:
    """(T,) where both feet point, as complex numbers of length 1."""
    turn = _complex(lengths(corners).sum(axis=1))
    return turn / np.maximum(np.abs(turn), 1e-9)


def _complex(flat: Floats) -> np.ndarray:
    """Points (…, 2) of the floor as complex numbers: they turn by multiplication."""
    return flat[..., 0] + 1j * flat[..., 1]


def _median(places: np.ndarray) -> complex:
    """The middle of complex numbers, axis by axis."""
    return complex(np.median(np.real(places)), np.median(np.imag(places)))
