"""OmniRetarget's penetration and skating, as `eval_retargeting.py` of holosoma (fc600e7) computes them for clips on a floor.

    penetration: share of frames whose deepest geom is over 1 cm under the floor, and its depth, mean over those frames
    stance: a foot of the human, scaled to the robot, whose toe moves at most 1 cm along the floor since the last frame
    skating: frames in which a toe of the robot in stance moves more, over frames with a foot in stance, and the faster
             of both toes, mean over the skating frames [arXiv 2509.26633, Table II]

Units: % of frames, cm, % of frames, cm/frame. Range: 0 to 100 %; 0 and more. Thresholds are per frame, so skating depends on the frame rate; the paper's is 30/s. The
human is scaled by the robot's leg over the human's; holosoma takes the height, or .747 for LAFAN1. The robot's toe is the keypoint at
the front of the sole: (.142, 0, −.030) m in the G1's ankle roll link, where holosoma has (.14, 0, −.03). A foot that stands on its
heel moves its toe: `skate_cm_s` is the speed of the slowest point of the sole. Contact preservation needs the pose of an object.
"""

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.robot.geoms import Placed
from robot_retarget.robot.surfaces import Floor
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import Subject

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
