"""Jerk of the joints.

    sqrt(mean over joints and frames of (q_{t+3} − 3 q_{t+2} + 3 q_{t+1} − q_t)²) · fps³

Unit: rad/s³. Range: 0 and more. It grows with the frame rate of noisy files: compare files of one rate. Source: LIMMT and
PHUMA filter by jerk.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The root mean square; None below four frames."""
    third = np.diff(subject.angles, 3, axis=0)
    return (np.sqrt((third**2).mean()) * subject.fps**3 if third.size else None,)


MEASURE = Measure((Figure("jerk_rms", "rad/s^3", 1, "jerk of the joints, root mean square"),), measure)
