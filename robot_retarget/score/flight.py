"""Frames in which no foot is on the floor, and how far the feet travel.

    flight: h_t > L + 3 cm,  h_t the lowest sole point, L the 5th percentile of h over the clip
    travel: max over feet and frames of the distance of the sole's middle from its first place, along the floor

Units: % of frames, m. Range: 0 to 100 %; 0 and more. A clip that floats as a whole is not in flight: `float_med_cm` says that.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The share of frames in flight, and the farthest step of a foot."""
    travel = max(np.linalg.norm(foot.middle - foot.middle[0], axis=1).max() for foot in subject.feet)
    return 100 * np.mean(~subject.standing), travel


MEASURE = Measure(
    (
        Figure("flight_pct", "%", 2, "frames with no foot on the floor", "neither", 100.0, "a jump"),
        Figure("feet_travel_m", "m", 3, "farthest that a foot goes from its first place", "neither"),
    ),
    measure,
    feet=True,
)
