"""Figures of root and forces, and one number for the physical defects of a reference motion.

root_jerk, root_height_min, travel_m: motion of the root

    jerk = mean_t ‖p_{t+3} − 3 p_{t+2} + 3 p_{t+1} − p_t‖ · fps³
    height = min_t of the root's height, over that in the reference pose on its soles
    travel = max_t ‖p_t − p_0‖ along the floor

Units: m/s³, 1, m. Range: 0 and more. Source: PHUMA keeps human clips with a root jerk below 50 m/s³ and a pelvis between 0.6 and 1.5 m [arXiv
2510.26236, `preprocess_smplx.py`]; its third filter, the distance to the base of support, has `zmp_out_pct` for a counterpart.

root_residual: the root's residual wrench, which no contact force provides

    r_t = ‖(f, τ/c)‖ / (m g),   (f, τ) = the root's part of inverse dynamics less contact forces, τ about the centre of mass

Contact forces act at the corners of the soles that stand, within friction pyramids (μ = 0.8), non-negative, and are chosen by
least squares. c is the height of the centre of mass in the reference pose. A motion that walks, runs or flies ballistically has
r = 0. Unit: 1. Range: 0 and more. Source: dynamic consistency as in KDMR and SPARK; velocities are smoothed over 0.05 s. Hands and
knees on the floor count as no contact.

torque_over_pct, torque_p99: torque of the motors against their limits, the share of joints × frames with |τ| > τ_max, and the 99th
percentile of |τ|/τ_max. τ from inverse dynamics with the contact forces of `root_residual`, without damping and friction. Units: %, 1.
Range: 0 to 100 %; 0 and more. None where the model has no torque limits. Source: the limits of the model or of its limits file.

physics_score: S = 100 · mean_i (1 − min(1, x_i / b_i)) over float, penetration, skate, overlap with itself and jerk: x_i the defect, b_i the
size at which it costs all of its share. Unit: points. Range: 0 to 100. Source: LIMMT's physical score has these five parts and keeps clips
from 90 up [arXiv 2606.06953]; the sizes b_i here are this project's, so that its threshold does not carry over.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.stance import planned_stance
from robot_retarget.human.activity import ActivityRule
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import momenta, root_dofs
from robot_retarget.robot.geoms import Floor, Placed
from robot_retarget.robot.timing import range_excess
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import OVERLAP, Subject

# Figures of the joints, and of links that overlap.
#
# limit_frames: frames in which a joint leaves its range, max_j max(l_j − q_j, q_j − u_j) > 1 mrad. Unit: frames, range: 0 to T. Source: the
# model's own joint ranges.
#
# speed_p99: 99th percentile over joints and frames of |q_{t+1} − q_t| · fps. Unit: rad/s, range: 0 and more. Source: jumps of joints are one of the
# artefacts that the GMR paper names critical.
#
# jerk_rms: sqrt(mean over joints and frames of (q_{t+3} − 3 q_{t+2} + 3 q_{t+1} − q_t)²) · fps³. Unit: rad/s³, range: 0 and more. It grows with the
# frame rate of noisy files: compare files of one rate. Source: LIMMT and PHUMA filter by jerk.
#
# moves_deg: the largest range of a hinge over the clip. Unit: deg, range: 0 and more. duration_s: (T − 1) / fps. Unit: s.
#
# self_pen_pct and self_pen_max_cm: share of frames with d_t > 1 mm, and max_t d_t, d_t the deepest overlap of two geoms at frame t, by
# MuJoCo's collision of the model's own collision geoms, less pairs of bodies that overlap already in the reference pose. Unit: %, cm. Range:
# 0 to 100 %, 0 and more cm. Source: GMR's users count it (issue 95 of GMR); mesh hulls overstate it, so the notes of a score name the
# collision model.
#
# NMR's counts of joint jumps, self-collision and joint limits [arXiv 2603.22201]:
#
#     jumps: steps with max_j |q_{t+1} − q_t| · fps > 15 rad/s (0.5 rad in a frame at 30 frames/s)
#     self-collision: frames with any overlap of the robot with itself
#     limits: frames with a joint in the outer 5 % of its range at either end, or beyond
#
# Units: steps, % of frames, % of frames. Range: 0 and more; 0 to 100 %. The paper states the counts and not its thresholds; those here are
# this project's. Its limit figure is not a violation of hard ranges: retargeters that keep them score 43 % in it.

EXCESS = 1e-3
"""Less beyond a range is rounding of a file [rad]."""
JUMP = 15.0
"""A faster hinge jumps [rad/s]: 0.5 rad between frames at 30 frames a second; servos reach up to 10."""
NEAR_RANGE = 0.05
"""Share of a joint's range at either end that is near its limit [-]: 5 %, as above."""


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
    margin = NEAR_RANGE * (robot.upper - robot.lower)
    near = (angles < robot.lower + margin) | (angles > robot.upper - margin)
    jumps = int((subject.speeds.max(axis=1, initial=0.0) > JUMP).sum())
    return jumps, 100 * np.mean(subject.depth > 0), 100 * np.mean(near.any(axis=1))


@dataclass(frozen=True)
class Sizes:
    """Defects that cost all of their share."""

    float_height: float = 0.05
    """Mean height of the lowest sole point over the floor, frames in flight left out, by definition [m]."""
    penetration: float = 0.02
    """Its mean depth under the floor, by definition [m]."""
    skate: float = 0.3
    """Mean speed of the slowest point of a foot on the floor, by definition [m/s]: a slow walk of the foot."""
    overlap: float = 0.25
    """Share of frames in which the robot overlaps itself by over 1 mm [-]."""
    jerk: float = 2000.0
    """Root mean square over the joints [rad/s³]: by comparison, about that of GMR's references of dances."""


@measures(
    Figure("root_jerk", "m/s^3", 2, "jerk of the root, mean"),
    Figure(
        "root_height_min", "", 3, "lowest root, over its standing height", "neither", cause="a squat, a fall or lying"
    ),
    Figure("travel_m", "m", 3, "farthest that the root goes from its first place", "neither"),
)
def root(subject: Subject) -> tuple[Value, ...]:
    """Jerk, least height and travel; None for a robot whose root is not free."""
    if not subject.robot.floating:
        return None, None, None
    place = subject.root
    third = np.linalg.norm(np.diff(place, 3, axis=0), axis=1) * subject.fps**3
    travel = np.linalg.norm(place[:, :2] - place[0, :2], axis=1).max()
    return (third.mean() if third.size else None), place[:, 2].min() / subject.standing_height, travel


@measures(
    Figure("root_residual", "weights", 3, "force on the root that no contact provides, mean"),
    Figure("root_residual_p95", "weights", 3, "the same, 95th percentile"),
    feet=True,
)
def root_residual(subject: Subject) -> tuple[Value, ...]:
    """The mean and the 95th percentile over the frames."""
    if not subject.robot.floating or len(subject) < 3:
        return None, None
    residual = _residuals(subject)
    return residual.mean(), np.percentile(residual, 95)


def _residuals(subject: Subject) -> Floats:
    """(T,) in weights of the robot."""
    robot, qpos = subject.robot, subject.trajectory.qpos
    model, first = robot.model, robot.root_address
    standing, centre = (_centres(robot, poses) for poses in (robot.neutral()[None], qpos))
    height = float(standing[0, 2] - subject.floor_of(robot.neutral()[None]))
    wrench = subject.forces[:, root_dofs(robot)]
    turns = Rotation.from_quat(qpos[:, first + 3 : first + 7], scalar_first=True)
    force, torque = wrench[:, :3], turns.apply(wrench[:, 3:])  # a free joint's torque is in its own frame
    about_centre = torque - np.cross(centre - subject.root, force)
    weight = float(model.body_subtreemass[robot.root_body] * robot.gravity)
    return np.linalg.norm(np.hstack([force, about_centre / height]), axis=1) / weight


def _centres(robot: Robot, poses: Floats) -> Floats:
    """(T, 3) the centre of mass [m]."""
    return momenta(robot, poses, np.zeros((len(poses), robot.model.nv)))[0]


@measures(
    Figure("torque_over_pct", "%", 2, "joints × frames that need more torque than the motors have", most=100.0),
    Figure("torque_p99", "", 3, "torque over its limit, 99th percentile"),
    feet=True,
)
def torque(subject: Subject) -> tuple[Value, ...]:
    """The share beyond the limits, and the percentile."""
    robot = subject.robot
    limited = np.isfinite(robot.max_torque) & (robot.max_torque > 0)
    if not robot.floating or not limited.any() or len(subject) < 3:
        return None, None
    ratio = np.abs(subject.forces[:, robot.dof_index[limited]]) / robot.max_torque[limited]
    return 100 * np.mean(ratio > 1), np.percentile(ratio, 99)


@measures(
    Figure("physics_score", "points", 1, "float, penetration, skate, overlap and jerk together", "higher", 100.0),
    feet=True,
)
def physics_score(subject: Subject) -> tuple[Value, ...]:
    """The score; None for fewer than four frames."""
    if subject.jerk is None:
        return (None,)
    sizes, lowest, down, standing = Sizes(), subject.lowest, subject.contacts.down[1:], ~subject.contacts.flying
    parts = (
        (np.maximum(lowest[standing], 0).mean() if standing.any() else 0.0) / sizes.float_height,
        np.maximum(-lowest, 0).mean() / sizes.penetration,
        (subject.slip[1:][down].mean() if down.any() else 0.0) / sizes.skate,
        np.mean(subject.depth > OVERLAP) / sizes.overlap,
        subject.jerk / sizes.jerk,
    )
    return (100 * np.mean([1 - min(1.0, float(part)) for part in parts]),)


# Figures of the feet. h_t is the height of the lowest sole point of both feet at frame t, L its 5th percentile over the clip.
#
# skate_cm_s: speed of a foot that should stand
#
#     mean over planted feet and frames of  min_p ‖Δp_xy‖ · fps,  p the sole points of the foot        unit: cm/s, range: 0 and more
#
# A foot is planted while the human's stands by the rule of `contact`. The slowest
# point counts, so that a foot that rolls over its edge does not skate. Source: this project.
#
# ground_pen_max_cm and float_med_cm: height of the soles over the floor z = 0
#
#     penetration = max(0, −min_t h_t),  float = median_t h_t        unit: cm, range: 0 and more; any sign
#
# Source: GMR's users (issue 180 of GMR).
#
# flight_pct: frames in which no foot is on the floor by the rule of `contact`, 2.5 % of a leg over it. Unit: % of frames, range: 0 to 100 %. A clip that floats as a whole is not
# in flight: `float_med_cm` says that.
#
# feet_travel_m: how far the feet travel, the largest distance of a sole's middle from its first place along the floor. Unit: m, range: 0 and more.
#
# held_pct: frames in which something other than the feet would have to hold the robot up: the root is lower than 80 % of its standing height
# h and farther than 0.3 h from the middle of the feet along the floor. Unit: % of frames, range: 0 to 100 %. The robot has no chair and does
# not push with its hands: a seat, an object and lying all count. Source: the rule of `human.features`, on the robot.
#
# zmp_out_pct and zmp_margin_cm: share of frames with a foot on the floor in which the zero moment point leaves the convex hull of the sole
# points that are down, and the 5th percentile of its distance inside. Unit: %, cm. Range: 0 to 100; any sign. Sole points within 6 mm of the
# lowest one are down, so that a tilted sole carries by its edge: on a reference that tilts its soles the figure counts tilt (one walk: 94 %;
# 12 % if points within 30 mm carry). A tracker that lays the sole flat has more support. Momenta are smoothed over 0.05 s. A robot that is driven by a tracker may leave its support
# for a moment and catch itself; a robot in open-loop playback falls. Source: PBHC calls a frame stable if centre of mass and centre of
# pressure are within 0.1 m [arXiv 2506.12851]; this is the dynamic form.

LOW = 0.8
"""Of the standing height; horizontal thighs leave 62 % of it [-]."""


@measures(
    Figure("skate_cm_s", "cm/s", 2, "speed of the slowest sole point of a planted foot"),
    Figure("planted_frames", "frames", 0, "feet × frames that are planted", "neither"),
    human=True,
    feet=True,
)
def skate(subject: Subject) -> tuple[Value, ...]:
    """The mean speed, and how many feet × frames it is over."""
    planted = subject.planted
    if planted is None:
        return None, None
    return 100 * subject.slip[planted].mean() if planted.any() else 0.0, int(np.sum(planted))


@measures(
    Figure("ground_pen_max_cm", "cm", 2, "lowest sole point under the floor, deepest"),
    Figure("float_med_cm", "cm", 2, "lowest sole point over the floor, median (any sign)"),
    feet=True,
)
def ground(subject: Subject) -> tuple[Value, ...]:
    """Deepest penetration and median height."""
    return max(0.0, -100 * subject.lowest.min()), 100 * np.median(subject.lowest)


@measures(
    Figure("flight_pct", "%", 2, "frames with no foot on the floor", "neither", 100.0, "a jump"),
    Figure("feet_travel_m", "m", 3, "farthest that a foot goes from its first place", "neither"),
    feet=True,
)
def flight(subject: Subject) -> tuple[Value, ...]:
    """The share of frames in flight, and the farthest step of a foot."""
    travel = max(np.linalg.norm(foot.middle - foot.middle[0], axis=1).max() for foot in subject.feet)
    return 100 * np.mean(subject.contacts.flying), travel


@measures(
    Figure(
        "held_pct", "%", 2, "frames in which more than the feet would have to hold it up", most=100.0,
        cause="a seat, hands or an object hold the human up, or it lies",
    ),
    feet=True,
)  # fmt: skip
def held(subject: Subject) -> tuple[Value, ...]:
    """The share of frames."""
    if not subject.robot.floating:
        return (None,)
    tall = subject.standing_height
    feet = np.mean([foot.middle for foot in subject.feet], axis=0)
    beside = np.linalg.norm(subject.root[:, :2] - feet, axis=1)
    low = subject.root[:, 2] - subject.floor_level < LOW * tall
    return (100 * np.mean(low & (beside > ActivityRule().seat_offset * tall)),)


@measures(
    Figure("zmp_out_pct", "%", 2, "frames with the zero moment point outside the support", most=100.0),
    Figure("zmp_margin_cm", "cm", 2, "its distance inside the support, 5th percentile (any sign)", "higher"),
    feet=True,
)
def zmp(subject: Subject) -> tuple[Value, ...]:
    """The share of frames, and the 5th percentile of the margin inside the support."""
    stance = planned_stance(subject.robot, subject.trajectory, subject.contacts)
    if stance is None:
        return None, None
    margin = stance.zmp_margin[~subject.contacts.flying & ~np.isnan(stance.zmp_margin)]
    return (100 * np.mean(margin < 0), 100 * np.percentile(margin, 5)) if margin.size else (None, None)


# OmniRetarget's penetration and skating, as `eval_retargeting.py` of holosoma (fc600e7) computes them for clips on a floor.
#
#     penetration: share of frames whose deepest geom is over 1 cm under the floor, and its depth, mean over those frames
#     stance: a foot of the human, scaled to the robot, whose toe moves at most 1 cm along the floor since the last frame
#     skating: frames in which a toe of the robot in stance moves more, over frames with a foot in stance, and the faster
#              of both toes, mean over the skating frames [arXiv 2509.26633, Table II]
#
# Units: % of frames, cm, % of frames, cm/frame. Range: 0 to 100 %; 0 and more. Thresholds are per frame, so skating depends on the frame rate; the paper's is 30/s. The
# human is scaled by the robot's leg over the human's; holosoma takes the height, or .747 for LAFAN1. The robot's toe is the keypoint at
# the front of the sole: (.142, 0, −.030) m in the G1's ankle roll link, where holosoma has (.14, 0, −.03). A foot that stands on its
# heel moves its toe: `skate_cm_s` is the speed of the slowest point of the sole. Contact preservation needs the pose of an object.

COUNTED_DEPTH = 0.01
"""Penetration beyond this counts [m]: 1 cm by the definition of OmniRetarget."""
TOE_STEP = 0.01
"""A toe in stance moves at most this far from frame to frame [m]: 1 cm by the definition of OmniRetarget."""
TOES = ("l_toe", "r_toe")


@measures(
    Figure("omni_pen_pct", "%", 2, "frames with a geom over 1 cm under the floor (OmniRetarget)", most=100.0),
    Figure("omni_pen_cm", "cm", 2, "depth of the deepest geom, mean over those frames (OmniRetarget)"),
)
def penetration(subject: Subject) -> tuple[Value, ...]:
    """The share of frames that penetrate, and the mean depth of their deepest geom."""
    depth = _depths(subject)
    deep = depth > COUNTED_DEPTH
    return 100 * deep.mean(), 100 * depth[deep].mean() if deep.any() else 0.0


@measures(
    Figure("omni_skate_pct", "%", 2, "frames in stance in which a toe slides over 1 cm (OmniRetarget)", most=100.0),
    Figure("omni_skate_cm", "cm/frame", 2, "slide of the faster toe, mean over those frames (OmniRetarget)"),
    human=True,
)
def skating(subject: Subject) -> tuple[Value, ...]:
    """The share of frames in stance that skate, and the mean slide of their faster toe."""
    pair = subject.pair
    if not pair.has(*TOES):
        return None, None
    toes = [pair.index(toe) for toe in TOES]
    human, robot = (np.linalg.norm(np.diff(x[:, toes, :2], axis=0), axis=2) for x in (pair.human, pair.robot))
    stance = human * pair.match.leg_ratio <= TOE_STEP
    slide = np.where(stance & (robot > TOE_STEP), robot, 0.0).max(axis=1)
    skates, stands = slide > 0, stance.any(axis=1)
    if not skates.any():
        return 0.0, 0.0
    return 100 * skates.sum() / stands.sum(), 100 * slide[skates].mean()


def _depths(subject: Subject) -> Floats:
    """(T,) how deep the deepest geom is under the floor [m]."""
    model = subject.robot.model
    placed = Placed.at(model, mujoco.MjData(model), subject.trajectory.qpos)
    return Floor(subject.robot, model, frozenset(), 0.0).depth(placed)
