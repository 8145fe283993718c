"""Frames in which something other than the feet would have to hold the robot up, and clips that hold no motion.

    held: the root is lower than 80 % of its standing height h and farther than 0.3 h from the middle of the feet along the floor
    duration: (T − 1) / fps;   moves: max over hinges of the range over the clip

Units: % of frames, s, deg. Range: 0 to 100 %; 0 and more. The robot has no chair and does not push with its hands: a seat, an object
and lying all count. Source: the rule of
`human.activity`, on the robot.
"""

import numpy as np

from robot_retarget.human.activity import ActivityRule
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.root import standing_height
from robot_retarget.score.subject import Subject

LOW = 0.8
"""Of the standing height; horizontal thighs leave 62 % of it [-]."""


def held(subject: Subject) -> tuple[Value, ...]:
    """The share of frames."""
    if not subject.robot.floating:
        return (None,)
    tall = standing_height(subject)
    feet = np.mean([foot.middle for foot in subject.feet], axis=0)
    beside = np.linalg.norm(subject.root[:, :2] - feet, axis=1)
    low = subject.root[:, 2] - subject.floor_level < LOW * tall
    return (100 * np.mean(low & (beside > ActivityRule().seat_offset * tall)),)


def extent(subject: Subject) -> tuple[Value, ...]:
    """The duration, and the largest range of a hinge."""
    return subject.trajectory.duration, np.degrees(np.ptp(subject.angles, axis=0).max(initial=0.0))


HELD = Measure(
    (
        Figure(
            "held_pct", "%", 2, "frames in which more than the feet would have to hold it up", most=100.0,
            cause="a seat, hands or an object hold the human up, or it lies",
        ),
    ),
    held,
    feet=True,
)  # fmt: skip
EXTENT = Measure(
    (
        Figure("duration_s", "s", 3, "length", "neither", cause="hardly a motion: too few frames"),
        Figure("moves_deg", "deg", 1, "largest range of a hinge", "neither", cause="a still: a T-pose or a rest"),
    ),
    extent,
)
