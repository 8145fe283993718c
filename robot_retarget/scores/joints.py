"""Figures of the joints, and of links that overlap.

limit_frames: frames in which a joint leaves its range, max_j max(l_j − q_j, q_j − u_j) > 1 mrad. Unit: frames, range: 0 to T. Source: the
model's own joint ranges.

speed_p99: 99th percentile over joints and frames of |q_{t+1} − q_t| · fps. Unit: rad/s, range: 0 and more. Source: jumps of joints are one of the
artefacts that the GMR paper names critical.

jerk_rms: sqrt(mean over joints and frames of (q_{t+3} − 3 q_{t+2} + 3 q_{t+1} − q_t)²) · fps³. Unit: rad/s³, range: 0 and more. It grows with the
frame rate of noisy files: compare files of one rate. Source: LIMMT and PHUMA filter by jerk.

moves_deg: the largest range of a hinge over the clip. Unit: deg, range: 0 and more. duration_s: (T − 1) / fps. Unit: s.

self_pen_pct and self_pen_max_cm: share of frames with d_t > 1 mm, and max_t d_t, d_t the deepest overlap of two geoms at frame t, by
MuJoCo's collision of the model's own collision geoms, less pairs of bodies that overlap already in the reference pose. Unit: %, cm. Range:
0 to 100 %, 0 and more cm. Source: GMR's users count it (issue 95 of GMR); mesh hulls overstate it, so the notes of a score name the
collision model.

NMR's counts of joint jumps, self-collision and joint limits [arXiv 2603.22201]:

    jumps: steps with max_j |q_{t+1} − q_t| · fps > 15 rad/s (0.5 rad in a frame at 30 frames/s)
    self-collision: frames with any overlap of the robot with itself
    limits: frames with a joint in the outer 5 % of its range at either end, or beyond

Units: steps, % of frames, % of frames. Range: 0 and more; 0 to 100 %. The paper states the counts and not its thresholds; those here are
this project's. Its limit figure is not a violation of hard ranges: retargeters that keep them score 43 % in it.
"""

import numpy as np

from robot_retarget.robot.timing import range_excess
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import OVERLAP, Subject

EXCESS = 1e-3
"""Less beyond a range is rounding of a file [rad]."""
JUMP = 15.0
"""Joint speed above this is a jump [rad/s]."""
MARGIN = 0.05
"""Share of a joint's range at either end that is near its limit [-]."""


@measures(Figure("limit_frames", "frames", 0, "frames with a joint past its range by over 1 mrad"))
def limits(subject: Subject) -> tuple[Value, ...]:
    """How many frames; joints without a range in the model have none to leave."""
    robot = subject.robot
    ranged = robot.model.jnt_limited[robot.joint_ids].astype(bool)
    excess = range_excess(subject.trajectory, robot)[:, ranged]
    return (int(np.sum(excess.max(axis=1, initial=0.0) > EXCESS)),)


@measures(Figure("speed_p99", "rad/s", 2, "speed of the joints, 99th percentile"))
def speed(subject: Subject) -> tuple[Value, ...]:
    """The percentile; None for a single frame."""
    return (np.percentile(subject.speeds, 99) if subject.speeds.size else None,)


@measures(Figure("jerk_rms", "rad/s^3", 1, "jerk of the joints, root mean square"))
def jerk(subject: Subject) -> tuple[Value, ...]:
    """The root mean square; None below four frames."""
    return (subject.jerk,)


@measures(
    Figure("duration_s", "s", 3, "length", "neither", cause="hardly a motion: too few frames"),
    Figure("moves_deg", "deg", 1, "largest range of a hinge", "neither", cause="a still: a T-pose or a rest"),
)
def extent(subject: Subject) -> tuple[Value, ...]:
    """The duration, and the largest range of a hinge."""
    return subject.trajectory.duration, np.degrees(np.ptp(subject.angles, axis=0).max(initial=0.0))


@measures(
    Figure("self_pen_pct", "%", 2, "frames in which the robot overlaps itself by over 1 mm", most=100.0),
    Figure("self_pen_max_cm", "cm", 2, "its deepest overlap"),
)
def self_penetration(subject: Subject) -> tuple[Value, ...]:
    """The share of frames and the deepest overlap."""
    return 100 * np.mean(subject.depth > OVERLAP), 100 * subject.depth.max()


@measures(
    Figure("joint_jumps", "steps", 0, "steps in which a joint turns faster than 15 rad/s (NMR)"),
    Figure("self_collision_pct", "%", 2, "frames with any overlap of the robot with itself (NMR)", most=100.0),
    Figure("near_limit_pct", "%", 2, "frames with a joint in the outer 5 % of its range (NMR)", most=100.0),
)
def nmr(subject: Subject) -> tuple[Value, ...]:
    """Jumps, self-collision and nearness to limits."""
    robot, angles = subject.robot, subject.angles
    margin = MARGIN * (robot.upper - robot.lower)
    near = (angles < robot.lower + margin) | (angles > robot.upper - margin)
    jumps = int((subject.speeds.max(axis=1, initial=0.0) > JUMP).sum())
    return jumps, 100 * np.mean(subject.depth > 0), 100 * np.mean(near.any(axis=1))
