"""Overlap of the robot with itself.

    d_t = the deepest overlap of two geoms at frame t, by MuJoCo's collision of the model's own collision geoms

less pairs of bodies that overlap already in the reference pose. The share counts frames with d_t > 1 mm. Units: %, cm. Range:
0 to 100 %, 0 and more cm. Source: GMR's users count it (issue 95 of GMR); mesh hulls overstate it, so the notes of a score name the collision model.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject

DEEP = 1e-3
"""Overlaps up to this depth are the softness of a touch [m]."""


def measure(subject: Subject) -> tuple[Value, ...]:
    """The share of frames and the deepest overlap."""
    return 100 * np.mean(subject.depth > DEEP), 100 * subject.depth.max()


MEASURE = Measure(
    (
        Figure("self_pen_pct", "%", 2, "frames in which the robot overlaps itself by over 1 mm", most=100.0),
        Figure("self_pen_max_cm", "cm", 2, "its deepest overlap"),
    ),
    measure,
)
