"""The path of the pelvis, carried over by the length of the leg."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.human import Human
from robot_retarget.describe.match import Match


def pelvis_path(human: Human, match: Match) -> Floats:
    """(T, 3) the human pelvis, scaled by the leg, starting above the origin, its ankles at the robot's height [m]."""
    x = human.positions
    pelvis = x[:, match.index("pelvis")] if "pelvis" in match.keypoints else x.mean(axis=1)
    path = (pelvis - [*pelvis[0, :2], 0.0]) * match.leg_ratio
    ankles = [match.index(k) for k in ("l_ankle", "r_ankle") if k in match.keypoints]
    if ankles:
        lowest = np.quantile(x[:, ankles, 2].min(axis=1), 0.05)
        path[:, 2] += match.ankle_height - lowest * match.leg_ratio
    return path
