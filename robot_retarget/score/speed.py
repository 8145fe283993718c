"""Speed of the joints.

    99th percentile over joints and frames of  |q_{t+1} − q_t| · fps

Unit: rad/s. Range: 0 and more. Source: jumps of joints are one of the artefacts that the GMR paper names critical.
"""

import numpy as np

from robot_retarget.robot.timing import joint_velocities
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The percentile; None for a single frame."""
    speed = np.abs(joint_velocities(subject.trajectory, subject.robot))
    return (np.percentile(speed, 99) if speed.size else None,)


MEASURE = Measure((Figure("speed_p99", "rad/s", 2, "speed of the joints, 99th percentile"),), measure)
