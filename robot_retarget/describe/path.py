"""The path of the pelvis, carried over by the length of the leg."""

from robot_retarget.arrays import Floats
from robot_retarget.describe.human import Human
from robot_retarget.describe.match import Match


def pelvis_path(human: Human, match: Match) -> Floats:
    """(T, 3) the human pelvis, scaled by the leg, starting above the origin, its ankles at the robot's height [m]."""
    x = human.positions
    pelvis = x[:, match.index("pelvis")] if "pelvis" in match.keypoints else x.mean(axis=1)
    path = (pelvis - [*pelvis[0, :2], 0.0]) * match.leg_ratio
    if {"l_ankle", "r_ankle"} & set(match.keypoints):
        path[:, 2] += match.ankle_height - human.ankle_height * match.leg_ratio
    return path
