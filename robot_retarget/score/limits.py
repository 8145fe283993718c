"""Frames in which a joint leaves its range.

    max_j max(l_j − q_j, q_j − u_j) > 1 mrad

Unit: frames. Range: 0 to T. Source: the model's own joint ranges.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject
from robot_retarget.simulate.figures import range_excess

EXCESS = 1e-3
"""Less beyond a range is rounding of a file [rad]."""


def measure(subject: Subject) -> tuple[Value, ...]:
    """How many frames; joints without a range in the model have none to leave."""
    robot = subject.robot
    ranged = robot.model.jnt_limited[robot.joint_ids].astype(bool)
    excess = range_excess(subject.trajectory, robot)[:, ranged]
    return (int(np.sum(excess.max(axis=1, initial=0.0) > EXCESS)),)


MEASURE = Measure((Figure("limit_frames", "frames", 0, "frames with a joint past its range by over 1 mrad"),), measure)
