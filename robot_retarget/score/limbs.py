"""Angle between a bone of the human and the robot's.

    θ = arccos(û · v̂),  u and v the bone on each body in the heading frame of its pelvis (the hip line)

over upper and lower arms, thighs, shins and the trunk. Unit: degree. Range: 0 to 180. Source: the direction error of motion
retargeting, as in GMR's and this project's comparisons.
"""

import numpy as np

from robot_retarget.graph.likeness import bone_angles
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The mean and the 95th percentile over bones and frames."""
    assert subject.pair is not None
    pair = subject.pair
    angles = np.degrees(list(bone_angles(pair.human, pair.robot, pair.keypoints, pair.parents).values()))
    return (angles.mean(), np.percentile(angles, 95)) if angles.size else (None, None)


MEASURE = Measure(
    (
        Figure("limb_deg_mean", "deg", 2, "angle between a human bone and the robot's, mean", most=180.0),
        Figure("limb_deg_p95", "deg", 2, "the same, 95th percentile", most=180.0),
    ),
    measure,
    human=True,
)
