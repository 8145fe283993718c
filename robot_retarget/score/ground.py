"""Height of the soles over the floor z = 0.

    h_t = the lowest sole point of both feet at frame t;  penetration = max(0, −min_t h_t),  float = median_t h_t

Unit: cm. Range: penetration 0 and more; float any sign. Source: GMR's users (issue 180 of GMR).
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """Deepest penetration and median height."""
    return max(0.0, -100 * subject.lowest.min()), 100 * np.median(subject.lowest)


MEASURE = Measure(
    (
        Figure("ground_pen_max_cm", "cm", 2, "lowest sole point under the floor, deepest"),
        Figure("float_med_cm", "cm", 2, "lowest sole point over the floor, median (any sign)"),
    ),
    measure,
    feet=True,
)
