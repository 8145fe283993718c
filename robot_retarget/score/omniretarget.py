"""OmniRetarget's penetration and skating, by the definitions of its `eval_retargeting.py` [arXiv 2509.26633, Table II].

    penetration: a frame counts where any geom is more than 1 cm under the floor; depth = mean over all frames of the deepest
    skating: stance where the human's toe moves at most 1 cm along the floor in a frame; skating where the robot's toe moves more

Units: % of frames, cm, % of stance, cm/frame. Range: 0 to 100 %; 0 and more. Thresholds are per frame, so the skating figures depend on the
frame rate; the paper's are at 30 frames/s. Objects and contact preservation are not measured: clips here hold none.
"""

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.floor import Floor
from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.subject import Subject

DEEP = 0.01
"""Penetration beyond this counts [m]."""
STEP = 0.01
"""A toe in stance moves at most this far in a frame [m]."""
TOES = ("l_toe", "r_toe")


def penetration(subject: Subject) -> tuple[Value, ...]:
    """The share of frames, and the mean of the frames' deepest geom."""
    depth = _depths(subject)
    return 100 * np.mean(depth > DEEP), 100 * depth.mean()


def skating(subject: Subject) -> tuple[Value, ...]:
    """The share of stance frames that skate, and the fastest of them."""
    pair = subject.pair
    assert pair is not None
    if not pair.has(*TOES):
        return None, None
    toes = [pair.index(toe) for toe in TOES]
    human, robot = (np.linalg.norm(np.diff(x[:, toes, :2], axis=0), axis=2) for x in (pair.human, pair.robot))
    stance = human <= STEP
    sliding = stance & (robot > STEP)
    share = 100 * sliding.sum() / stance.sum() if stance.any() else 0.0
    return share, 100 * robot[sliding].max(initial=0.0)


def _depths(subject: Subject) -> Floats:
    """(T,) how deep the deepest geom is under the floor [m]."""
    robot, data = subject.robot, mujoco.MjData(subject.robot.model)
    floor, depths = Floor(robot, robot.model, data, frozenset(), 0.0), np.zeros(len(subject))
    for t, qpos in enumerate(subject.trajectory.qpos):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(robot.model, data)
        depths[t] = floor.depth()
    return depths


PENETRATION = Measure(
    (
        Figure("omni_pen_pct", "%", 2, "frames with a geom over 1 cm under the floor (OmniRetarget)", most=100.0),
        Figure("omni_pen_cm", "cm", 2, "depth of the deepest geom, mean over frames (OmniRetarget)"),
    ),
    penetration,
)
SKATING = Measure(
    (
        Figure("omni_skate_pct", "%", 2, "stance frames in which a toe slides over 1 cm (OmniRetarget)", most=100.0),
        Figure("omni_skate_cm", "cm/frame", 2, "fastest slide of a toe in stance (OmniRetarget)"),
    ),
    skating,
    human=True,
)
