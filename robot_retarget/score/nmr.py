"""NMR's counts of joint jumps, self-collision and joint limits [arXiv 2603.22201].

    jumps: steps with max_j |q_{t+1} − q_t| · fps > 15 rad/s (0.5 rad in a frame at 30 frames/s)
    self-collision: frames with any overlap of the robot with itself
    limits: frames with a joint in the outer 5 % of its range at either end, or beyond

Units: steps, % of frames, % of frames. Range: 0 and more; 0 to 100 %. The paper states the counts and not its thresholds; those here are
this project's. Its limit figure is not a violation of hard ranges: retargeters that keep them score 43 % in it.
"""

import numpy as np

from robot_retarget.robot.timing import joint_velocities
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject

JUMP = 15.0
"""Joint speed above this is a jump [rad/s]."""
MARGIN = 0.05
"""Share of a joint's range at either end that is near its limit [-]."""


def measure(subject: Subject) -> tuple[Value, ...]:
    """Jumps, self-collision and nearness to limits."""
    speed = np.abs(joint_velocities(subject.trajectory, subject.robot))
    robot, angles = subject.robot, subject.angles
    margin = MARGIN * (robot.upper - robot.lower)
    near = (angles < robot.lower + margin) | (angles > robot.upper - margin)
    return (
        int((speed.max(axis=1, initial=0.0) > JUMP).sum()),
        100 * np.mean(subject.depth > 0),
        100 * np.mean(near.any(axis=1)),
    )


MEASURE = Measure(
    (
        Figure("joint_jumps", "steps", 0, "steps in which a joint turns faster than 15 rad/s (NMR)"),
        Figure("self_collision_pct", "%", 2, "frames with any overlap of the robot with itself (NMR)", most=100.0),
        Figure("near_limit_pct", "%", 2, "frames with a joint in the outer 5 % of its range (NMR)", most=100.0),
    ),
    measure,
)
