"""Difference of normalised distances between pairs of keypoints.

    | ‖x_u − x_v‖/τ_uv − ‖y_u − y_v‖/τ'_uv |,  τ the length of the path between u and v over the skeleton

over all pairs, and over those that are near in the human: ‖x_u − x_v‖/τ_uv < 0.35. Unit: 1. Range: 0 to 1. Source:
the normalisation of [Mucherino2017].
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.reach import closeness
from robot_retarget.score.subject import Subject

NEAR = 0.35
"""Pairs below this normalised distance are near [-]."""


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean over all pairs, and over near pairs."""
    assert subject.pair is not None
    human, robot = closeness(subject.pair)
    error, near = np.abs(human - robot), human < NEAR
    return error.mean(), error[near].mean() if near.any() else None


MEASURE = Measure(
    (
        Figure("distance_err_mean", "", 4, "error of normalised distances over all pairs of keypoints", most=1.0),
        Figure("near_err", "", 4, "the same over pairs that are near in the human", most=1.0),
    ),
    measure,
    human=True,
)
