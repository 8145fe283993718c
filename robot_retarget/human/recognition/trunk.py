"""Chest, neck and head: the joints between two legs and two arms, and above the arms."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.human.recognition.limbs import SAME, Limb, LimbPair, PosedSkeleton

HEAD_ABOVE_SHOULDERS = 0.2
"""Height of the head joint over the shoulders, in leg lengths (0.16 … 0.21 on the rigs measured; the crown: 0.35)."""
LEVEL = 0.1
"""Joints of the spine that differ by no more in height are level with each other, and so are joints and shoulders [leg
lengths]."""


@dataclass(frozen=True)
class Found:
    """A joint of the trunk, how it is known, and the lead of its score over that of the next best place."""

    joint: int
    why: str
    lead: float = np.inf


def find_trunk(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> dict[str, Found]:
    """The joints of chest, neck and head that this body has."""
    height = _heights(body, legs, arms)
    found: dict[str, Found] = {}
    chest = _chest(body, legs, arms, height)
    if chest is not None:
        found["chest"] = Found(chest, "where neck and arms branch off the spine")
    scores = _heads(body, legs, arms, height, chest)
    if scores:
        head = max(scores, key=scores.__getitem__)
        others = [score for joint, score in scores.items() if body.distance(joint, head) > SAME * legs.length]
        lead = scores[head] - max(others, default=-np.inf)
        found["head"] = Found(head, f"{height[head]:.2f} leg lengths above the shoulders", lead)
        neck = _neck(body, legs, head, height, chest)
        if neck is not None:
            found["neck"] = Found(neck, "the joint below the head", lead)
    return found


def _neck(body: PosedSkeleton, legs: LimbPair, head: int, height: np.ndarray, chest: int | None) -> int | None:
    """The joint below a head that is still over the chest."""
    below = (k for k in body.skeleton.above(head)[1:] if body.distance(k, head) > SAME * legs.length)
    neck = next(below, None)
    over = neck is not None and neck not in (chest, legs.hub) and height[neck] > height[chest or legs.hub]
    return neck if over else None


def _heights(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> np.ndarray:
    """(J,) height of every joint over the shoulders along the trunk, in leg lengths."""
    hips, shoulders = body.at(legs, 0).mean(axis=1), body.at(arms, 0).mean(axis=1)
    up = unit(shoulders - hips)
    return np.einsum("fji,fi->fj", body.positions - shoulders[:, None], up).mean(axis=0) / legs.length


def _chest(body: PosedSkeleton, legs: LimbPair, arms: LimbPair, height: np.ndarray) -> int | None:
    """The arms' hub, or the first spine joint below where the arms hang from the neck or from above the shoulders.

    A hub that is level with the shoulders is the chest if its name speaks of the spine (`Thorax`) and no other joint of
    the spine is near below it.
    """
    hips = float(np.mean([height[limb.joints[0]] for limb in legs.sides]))
    spine = list(body.skeleton.above(arms.hub))
    for joint, below in zip(spine, [*spine[1:], legs.hub], strict=True):
        parts = body.evidence[joint].parts
        lone = "spine" in parts and height[joint] - height[below] > LEVEL
        neck = "neck" in parts or height[joint] > (LEVEL if lone else 0.0)
        if not neck and height[joint] > hips + LEVEL:
            return joint
        if joint == legs.hub:
            break
    return None


def _heads(
    body: PosedSkeleton, legs: LimbPair, arms: LimbPair, height: np.ndarray, chest: int | None
) -> dict[int, float]:
    """Scores of the joints off the limbs that are called a head, or stand over a neck where a head is."""
    limbs = legs.below(body) | arms.below(body)
    trunk = set(body.skeleton.above(arms.hub))
    shoulders = [limb.joints[0] for limb in arms.sides]
    scores = {}
    for joint in range(len(height)):
        if joint in limbs or joint in trunk or chest not in (None, *body.skeleton.above(joint)):
            continue
        aside = abs(body.distance(joint, shoulders[0]) - body.distance(joint, shoulders[1])) / legs.length
        score = (
            -0.5 * ((height[joint] - HEAD_ABOVE_SHOULDERS) / LEVEL) ** 2
            - 10 * aside
            + 3 * body.evidence[joint].agreement("head")
            - 3 * body.evidence[joint].tip
            + 0.5 * (_neck(body, legs, joint, height, chest) is not None)
            - 0.5 * (not body.children[joint])
            + 0.5 * (len(body.children[joint]) > 1)
            - 0.08 * len(body.skeleton.above(joint))
        )
        scores[joint] = float(score)
    return scores


# Which side is left: from the build and the motion of a body, before the names of its joints.
#
# Left = up × forward. Up runs from the hips to the shoulders; forward is where the feet point and the knees bend to, and
# away from where the elbows bend to.

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
