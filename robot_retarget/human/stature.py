"""The stature of a recognised body, in the unit of its positions."""

from itertools import pairwise
from math import fsum

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.keypoints import SIDES
from robot_retarget.human.recognition.recognise import Recognition

LEG = 0.83
"""Hip to ankle of an adult of 1.70 m [m]."""
_HIP_TO_ANKLE = 0.491
_ANKLE_TO_HEAD = 0.86
"""Shares of the stature: thigh and shank [Winter2009], and ankle to head joint with the back's bones laid end to end."""


def leg_length(recognition: Recognition, positions: Floats) -> float:
    """Hip to knee to ankle, the mean of both legs.

    Args:
        positions: (T, J, 3) of the joints [any unit].
    """
    bones = [
        _length(recognition, positions, *(f"{side}_{part}" for part in ("hip", "knee", "ankle"))) for side in SIDES
    ]
    return sum(bones) / len(bones)


def stature(recognition: Recognition, positions: Floats) -> float:
    """Legs and spine end to end over their share of the stature; from the legs alone for a body without a head.

    Args:
        positions: (T, J, 3) of the joints [any unit].
    """
    leg = leg_length(recognition, positions)
    if "head" not in recognition.marks:
        return leg / _HIP_TO_ANKLE
    spine = [keypoint for keypoint in ("pelvis", "chest", "neck", "head") if keypoint in recognition.marks]
    return (leg + _length(recognition, positions, *spine)) / _ANKLE_TO_HEAD


def _length(recognition: Recognition, positions: Floats, *path: str) -> float:
    """Median length of a path over keypoints."""
    points = [positions[:, list(recognition.marks[keypoint].joints)].mean(axis=1) for keypoint in path]
    steps = [np.linalg.norm(b - a, axis=1) for a, b in pairwise(points)]
    return fsum(np.median(step) for step in steps)  # `sum` rounds otherwise from Python 3.12 on
