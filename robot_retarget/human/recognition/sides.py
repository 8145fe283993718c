"""Which side is left: from the build and the motion of a body, before the names of its joints.

Left = up × forward. Up runs from the hips to the shoulders; forward is where the feet point and the knees bend to, and
away from where the elbows bend to.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.human.recognition.limbs import Limb, LimbPair, PosedSkeleton

SURE = 0.3
"""Certainty from which geometry overrules names."""
HEEL = 0.08
"""What feet must say against names and knees to be heels, and these against them [leg lengths]: two heels 3 cm behind."""


ELBOWS = 0.25
"""Weight of elbows against feet and knees [-]: a T-pose bends them either way."""


@dataclass(frozen=True)
class Votes:
    """What feet, knees and elbows say of the first of two legs: above 0 it is the left one."""

    feet: float
    knees: float
    elbows: float

    def leftness(self, feet: bool = True) -> float:
        """1 surely left, −1 surely not, 0 unknown; without the feet where these are not to be believed."""
        return float(np.tanh(8 * (self.feet * feet + self.knees + self.elbows)))


def votes(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> Votes:
    """Return the evidence of feet, knees and elbows for the first leg as the left one."""
    hips, shoulders = body.at(legs, 0), body.at(arms, 0)
    up = unit(shoulders.mean(axis=1) - hips.mean(axis=1))
    line = unit(hips[:, 0] - hips[:, 1])
    feet = [
        body.positions[:, toe] - body.positions[:, limb.joints[2]] for limb in legs.sides if (toe := body.toe(limb))
    ]
    return Votes(
        _vote(line, up, feet, legs.length),
        _vote(line, up, [_bend(body, limb) for limb in legs.sides], legs.length),
        -ELBOWS * _vote(line, up, [_bend(body, limb) for limb in arms.sides], arms.length),
    )


def named_leftness(body: PosedSkeleton, pair: LimbPair) -> int:
    """The side of the first limb of a pair by its names: 1 left, −1 right, 0 unknown.

    Args:
        pair: two limbs.
    """
    value = {"l": 1, "r": -1, "": 0}
    first, second = (sum(value[body.evidence[joint].side] for joint in limb.joints) for limb in pair.sides)
    return int(np.sign(first - second))


def same_side_first(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> bool:
    """Whether the first arm is on the side of the first leg."""
    lines = [joints[:, 0] - joints[:, 1] for joints in (body.at(legs, 0), body.at(arms, 0))]
    return float(np.einsum("fi,fi->f", *lines).mean()) >= 0


def _bend(body: PosedSkeleton, limb: Limb) -> Floats:
    """(F, 3) from the middle of a limb's ends to its middle joint."""
    first, middle, last = (body.positions[:, joint] for joint in limb.joints)
    return middle - (first + last) / 2


def _vote(line: Floats, up: Floats, forward: list[Floats], scale: float) -> float:
    """Mean of line · (up × forward), forward in units of the limb."""
    return sum(float(np.einsum("fi,fi->f", line, np.cross(up, vector)).mean()) for vector in forward) / scale
