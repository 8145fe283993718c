"""Figures of the feet. h_t is the height of the lowest sole point of both feet at frame t, L its 5th percentile over the clip.

skate_cm_s: speed of a foot that should stand

    mean over planted feet and frames of  min_p ‖Δp_xy‖ · fps,  p the sole points of the foot        unit: cm/s, range: 0 and more

A foot is planted where the human's stands by the rule of `contact`. The slowest
point is taken, so that a foot that rolls over its edge does not skate. Source: this project.

ground_pen_max_cm and float_med_cm: height of the soles over the floor z = 0

    penetration = max(0, −min_t h_t),  float = median_t h_t        unit: cm, range: 0 and more; any sign

Source: GMR's users (issue 180 of GMR).

flight_pct: frames in which no foot is on the floor by the rule of `contact`, 2.5 % of a leg over it. Unit: % of frames, range: 0 to 100 %. A clip that floats as a whole is not
in flight: `float_med_cm` says that.

feet_travel_m: how far the feet travel, the largest distance of a sole's middle from its first place along the floor. Unit: m, range: 0 and more.

held_pct: frames in which something other than the feet would have to hold the robot up: the root is lower than 80 % of its standing height
h and farther than 0.3 h from the middle of the feet along the floor. Unit: % of frames, range: 0 to 100 %. The robot has no chair and does
not push with its hands: a seat, an object and lying all count. Source: the rule of `human.features`, on the robot.

zmp_out_pct and zmp_margin_cm: share of frames with a foot on the floor in which the zero moment point leaves the convex hull of the sole
points that are down, and the 5th percentile of its distance inside. Unit: %, cm. Range: 0 to 100; any sign. Sole points within 6 mm of the
lowest one are down, so that a tilted sole carries by its edge: on a reference that tilts its soles the figure counts tilt (one walk: 94 %;
12 % if points within 30 mm carry). A tracker that lays the sole flat has more support. Momenta are smoothed over 0.05 s. A robot that is driven by a tracker may leave its support
for a moment and catch itself; a robot in open-loop playback falls. Source: PBHC calls a frame stable if centre of mass and centre of
pressure are within 0.1 m [arXiv 2506.12851]; this is the dynamic form.
"""

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.features import ActivityRule
from robot_retarget.robot.dynamics import planned_stance
from robot_retarget.robot.geoms import Placed
from robot_retarget.robot.surfaces import Floor
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import Subject

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
    return 100 * np.mean(~subject.standing), travel


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
    stance = planned_stance(subject.robot, subject.trajectory)
    if stance is None:
        return None, None
    margin = stance.zmp_margin[subject.standing & ~np.isnan(stance.zmp_margin)]
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

DEEP = 0.01
"""Penetration beyond this counts [m]."""
STEP = 0.01
"""A toe in stance moves at most this far in a frame [m]."""
TOES = ("l_toe", "r_toe")


@measures(
    Figure("omni_pen_pct", "%", 2, "frames with a geom over 1 cm under the floor (OmniRetarget)", most=100.0),
    Figure("omni_pen_cm", "cm", 2, "depth of the deepest geom, mean over those frames (OmniRetarget)"),
)
def penetration(subject: Subject) -> tuple[Value, ...]:
    """The share of frames that penetrate, and the mean depth of their deepest geom."""
    depth = _depths(subject)
    deep = depth > DEEP
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
    stance = human * pair.match.leg_ratio <= STEP
    slide = np.where(stance & (robot > STEP), robot, 0.0).max(axis=1)
    skates, stands = slide > 0, stance.any(axis=1)
    if not skates.any():
        return 0.0, 0.0
    return 100 * skates.sum() / stands.sum(), 100 * slide[skates].mean()


def _depths(subject: Subject) -> Floats:
    """(T,) how deep the deepest geom is under the floor [m]."""
    model = subject.robot.model
    placed = Placed.at(model, mujoco.MjData(model), subject.trajectory.qpos)
    return Floor(subject.robot, model, frozenset(), 0.0).depth(placed)
