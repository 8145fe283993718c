"""One number for the physical defects of a reference motion.

    S = 100 · mean_i (1 − min(1, x_i / b_i))

over float, penetration, skate, overlap with itself and jerk: x_i the defect, b_i the size at which it costs all of its share.
Unit: points. Range: 0 to 100. Source: LIMMT's physical score has these five parts and keeps clips from 90 up [arXiv 2606.06953]; the sizes b_i
here are this project's, so that its threshold does not carry over.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


@dataclass(frozen=True)
class Sizes:
    """Defects that cost all of their share."""

    float_height: float = 0.05
    """Mean height of the lowest sole point over the floor, frames in flight left out [m]."""
    penetration: float = 0.02
    """Its mean depth under the floor [m]."""
    skate: float = 0.3
    """Mean speed of the slowest point of a foot on the floor [m/s]: a slow walk of the foot."""
    overlap: float = 0.25
    """Share of frames in which the robot overlaps itself by over 1 mm [-]."""
    jerk: float = 2000.0
    """Root mean square over the joints [rad/s³]: that of GMR's references of dances, about."""


def measure(subject: Subject) -> tuple[Value, ...]:
    """The score; None for fewer than four frames."""
    if len(subject) < 4:
        return (None,)
    sizes, lowest = Sizes(), subject.lowest
    third = np.diff(subject.angles, 3, axis=0)
    down = subject.on_floor[1:]
    parts = (
        (np.maximum(lowest[subject.standing], 0).mean() if subject.standing.any() else 0.0) / sizes.float_height,
        np.maximum(-lowest, 0).mean() / sizes.penetration,
        (subject.slip[1:][down].mean() if down.any() else 0.0) / sizes.skate,
        np.mean(subject.depth > 1e-3) / sizes.overlap,
        np.sqrt((third**2).mean()) * subject.fps**3 / sizes.jerk,
    )
    return (100 * np.mean([1 - min(1.0, float(part)) for part in parts]),)


MEASURE = Measure(
    (Figure("physics_score", "points", 1, "float, penetration, skate, overlap and jerk together", "higher", 100.0),),
    measure,
    feet=True,
)
