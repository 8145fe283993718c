"""The path of the pelvis, scaled by the length of the leg."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import Match


@dataclass(frozen=True, eq=False)
class RootScaling:
    """How places of the human become places of the robot:  y = r (x − o),  with the heights of the ankles made to fit."""

    ratio: float
    """r, robot leg over human leg [-]."""
    origin: Floats
    """(3,) o, the point that becomes the origin [m]: the human's first place, at the height that puts ankles at the
    robot's."""
    pelvis: int | None
    """Index of the pelvis among the keypoints; None uses the mean of all."""

    def path(self, human: HumanFeatures) -> Floats:
        """Return (T, 3) target positions of the pelvis [m]."""
        x = human.positions
        where = x.mean(axis=1) if self.pelvis is None else x[:, self.pelvis]
        return (where - self.origin) * self.ratio


def root_scaling_of(human: HumanFeatures, match: Match) -> RootScaling:
    """Return the scaling of the path of the root; the scaled path starts above the origin."""
    x, ratio = human.positions, match.leg_ratio
    pelvis = match.index("pelvis") if "pelvis" in match.keypoints else None
    first = x[0].mean(axis=0) if pelvis is None else x[0, pelvis]
    ankles = {"l_ankle", "r_ankle"} & set(match.keypoints)
    low = human.ankle_height - match.ankle_height / ratio if ankles else 0.0
    return RootScaling(ratio, np.array([*first[:2], low]), pelvis)


def pelvis_path(human: HumanFeatures, match: Match) -> Floats:
    """(T, 3) the human pelvis, scaled by the leg, starting above the origin, its ankles at the robot's height [m]."""
    return root_scaling_of(human, match).path(human)
