"""Speed of a foot that should stand.

    mean over planted feet and frames of  min_p ‖Δp_xy‖ · fps,  p the sole points of the foot

A foot is planted where the human's toe is slow (0.2 leg lengths/s) and low (8 % of a leg over the floor). The slowest
point is taken, so that a foot that rolls over its edge does not skate. Unit: cm/s. Range: 0 and more. Source: this project.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean speed, and how many feet × frames it is over."""
    planted = subject.planted
    if planted is None:
        return None, None
    return 100 * subject.slip[planted].mean() if planted.any() else 0.0, int(np.sum(planted))


MEASURE = Measure(
    (
        Figure("skate_cm_s", "cm/s", 2, "speed of the slowest sole point of a planted foot"),
        Figure("planted_frames", "frames", 0, "feet × frames that are planted", "neither"),
    ),
    measure,
    human=True,
    feet=True,
)
