"""Angle between the shoulder lines of human and robot, each seen from its own hips: a twisted waist.

    θ = arccos(û · v̂),  u and v from the right to the left shoulder, in the heading of each pelvis

Unit: degree. Range: 0 to 180. Source: waist jumps are the artefact that GMR's authors blame for failures of trained policies.
"""

import numpy as np

from robot_retarget.arrays import unit
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean and the largest over the frames."""
    pair = subject.pair
    assert pair is not None
    if not pair.has("l_shoulder", "r_shoulder"):
        return None, None
    left, right = pair.index("l_shoulder"), pair.index("r_shoulder")
    human, robot = (
        unit(np.einsum("tij,tj->ti", turn, x[:, left] - x[:, right]))
        for turn, x in zip(pair.headings, (pair.human, pair.robot), strict=True)
    )
    twist = np.degrees(np.arccos(np.clip((human * robot).sum(axis=1), -1.0, 1.0)))
    return twist.mean(), twist.max()


MEASURE = Measure(
    (
        Figure("twist_deg_mean", "deg", 2, "angle between the shoulder lines, seen from the hips, mean", most=180.0),
        Figure("twist_deg_max", "deg", 2, "the same, largest", most=180.0),
    ),
    measure,
    human=True,
)
