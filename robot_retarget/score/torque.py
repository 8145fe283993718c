"""Torque of the motors against their limits.

    share of joints × frames with |τ| > τ_max, and the 99th percentile of |τ|/τ_max

τ from inverse dynamics with the contact forces of `root_residual`, without damping and friction. Units: %, 1. Range: 0 to 100 %; 0 and more.
None where the model has no torque limits. Source: the limits of the model or of its limits file.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject


def measure(subject: Subject) -> tuple[Value, ...]:
    """The share beyond the limits, and the percentile."""
    robot = subject.robot
    limited = np.isfinite(robot.max_torque) & (robot.max_torque > 0)
    if not robot.floating or not limited.any() or len(subject) < 3:
        return None, None
    ratio = np.abs(subject.forces[:, robot.dof_index[limited]]) / robot.max_torque[limited]
    return 100 * np.mean(ratio > 1), np.percentile(ratio, 99)


MEASURE = Measure(
    (
        Figure("torque_over_pct", "%", 2, "joints × frames that need more torque than the motors have", most=100.0),
        Figure("torque_p99", "", 3, "torque over its limit, 99th percentile"),
    ),
    measure,
    feet=True,
)
