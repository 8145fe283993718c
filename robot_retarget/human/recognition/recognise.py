"""Which joint of a human skeleton is which keypoint: from names, tree and geometry together.

Legs and arms are found first (`limbs`), then the trunk between them (`trunk`), then which side is left (`sides`). It
works in any unit and any axes, on the names of any exporter, and with less certainty on names that mean nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import fsum
from typing import Any

import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, unit
from robot_retarget.base.errors import MatchError, known
from robot_retarget.base.keypoints import KEYPOINTS, SIDES
from robot_retarget.human.recognition.limbs import LIMBS, SAME, Limb, LimbPair, PosedSkeleton, find_limbs
from robot_retarget.human.skeleton import Skeleton

# Chest, neck and head: the joints between two legs and two arms, and above the arms.

HEAD_ABOVE_SHOULDERS = 0.2
"""Height of the head joint over the shoulders, in leg lengths (0.16 … 0.21 on the rigs measured; the crown: 0.35)."""
SPINE_LEVEL = 0.1
"""Joints of the spine that differ by no more in height are level with each other, and so are joints and shoulders [leg
lengths]. Half recognises 13 exporters alike, double errs in one."""


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
        lone = "spine" in parts and height[joint] - height[below] > SPINE_LEVEL
        neck = "neck" in parts or height[joint] > (SPINE_LEVEL if lone else 0.0)
        if not neck and height[joint] > hips + SPINE_LEVEL:
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
            -0.5 * ((height[joint] - HEAD_ABOVE_SHOULDERS) / SPINE_LEVEL) ** 2
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

OVERRULES = 0.3
"""Certainty from which geometry overrules names. Half and double recognise clips of 13 exporters alike."""
HEEL = 0.08
"""What feet must say against names and knees to be heels, and these against them [leg lengths]: two heels 3 cm behind."""


ELBOWS = 0.25
"""Weight of elbows against feet and knees [-]: a T-pose bends them either way. Half and double recognise clips of 13
exporters alike."""


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


# Whether a body with two legs and two arms is a human one.

ARM_TO_LEG = (0.35, 1.3)
"""Arms over legs of a human body [-]: 0.47 to 0.68 in 14 exporters (`limbs`), with room for stylised bodies."""
FOUR_LEGGED_ARM = 0.85
"""Arms of at least this share of the legs can be forelegs; a human on hands and knees has 0.5 … 0.75."""


def refuse_other_than_human(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> None:
    """Check proportions and posture.

    Raises:
        MatchError: with the reason.
    """
    tails = [
        body.skeleton.names[k] for pair in (legs, arms) for limb in pair.sides for k in limb.joints if _tail(body, k)
    ]
    if tails:
        raise MatchError(f"not a human body: {tails[0]!r}, which would be in a limb, is called a tail")
    (low, high), ratio = ARM_TO_LEG, arms.length / legs.length
    if not low <= ratio <= high:
        raise MatchError(f"not a human body: arms measure {ratio:.2f} of the legs, a human's {low} to {high}")
    forelegs = arms.length > FOUR_LEGGED_ARM * legs.length or any(_tail(body, k) for k in range(len(body.evidence)))
    if forelegs and four_legged(body, legs, arms) > 0.5:
        raise MatchError(
            "not a human body: hands bear weight like feet, hips and shoulders at the same height (a quadruped)"
        )


def four_legged(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> float:
    """Share of the frames in which arms and legs are parallel and the trunk lies across them."""
    hips, shoulders = body.at(legs, 0).mean(axis=1), body.at(arms, 0).mean(axis=1)
    leg, arm = body.at(legs, 2).mean(axis=1) - hips, body.at(arms, 2).mean(axis=1) - shoulders
    return float(np.mean((_cosine(leg, arm) > ALIGNED) & (np.abs(_cosine(leg, shoulders - hips)) < ALIGNED)))


def _tail(body: PosedSkeleton, joint: int) -> bool:
    return "tail" in body.evidence[joint].parts


def _cosine(u: Floats, v: Floats) -> Floats:
    return np.einsum("fi,fi->f", unit(u), unit(v))


_WORD = {"chest": "spine"}
"""Keypoints whose part has another name in `joint_names`."""

SILENT = 0.65
"""Confidence in a joint whose name is silent and that no other rivals. Half and double recognise clips of 13 exporters alike."""
ODDS = 4.0
"""Of two rivals the better one is right with the odds e^(LEAD · lead): even ones as often as not, by a lead of 0.5 7 in 8 times.
Half changes the sureness of joints in 8 of 34 clips, and double in 2."""


@dataclass(frozen=True)
class Mark:
    """The joints whose mean is a keypoint, how sure that is (0 … 1), and why."""

    joints: tuple[int, ...]
    confidence: float
    evidence: str


@dataclass(frozen=True)
class Recognition:
    """Where the keypoints of a body are in its skeleton."""

    marks: Mapping[str, Mark]
    notes: tuple[str, ...] = ()
    segments: Mapping[str, str] = field(default_factory=dict)
    """Per segment the joint whose rotation is its forward, left and up; empty if rotations have other axes."""
    ankle_height: float | None = None
    """Height of the ankles above level soles at z = 0 [m], where the source knows its body and floor."""
    names: tuple[str, ...] = ()
    """The joints of the skeleton."""

    @property
    def keypoints(self) -> tuple[str, ...]:
        """The keypoints that were found, in the order of `keypoints.KEYPOINTS`."""
        return tuple(keypoint for keypoint in KEYPOINTS if keypoint in self.marks)

    @property
    def missing(self) -> tuple[str, ...]:
        """The keypoints this body does not have."""
        return tuple(keypoint for keypoint in KEYPOINTS if keypoint not in self.marks)

    @property
    def confidence(self) -> float:
        """That of the least certain keypoint."""
        return min(mark.confidence for mark in self.marks.values())

    def weights(self, keypoints: Sequence[str], joints: int) -> Floats:
        """Return (K, J) shares of the joints in keypoints: each is the mean of the joints that mark it."""
        shares = np.zeros((len(keypoints), joints))
        for row, keypoint in zip(shares, keypoints, strict=True):
            marked = list(self.marks[keypoint].joints)
            row[marked] = 1 / len(marked)
        return shares

    def place(self, positions: Floats) -> Floats:
        """Return the keypoints (T, K, 3) of joint positions (T, J, 3), in the order of `keypoints`."""
        return self.weights(self.keypoints, positions.shape[1]) @ positions


def recognise(skeleton: Skeleton, positions: Floats) -> Recognition:
    """Find the keypoints of a human skeleton.

    Args:
        skeleton: names and tree; its offsets are not looked at.
        positions: (T, J, 3) of the joints over the motion, in any unit and any axes.

    Raises:
        MatchError: the body is not human, or two legs and two arms cannot be found; says why.
    """
    body = PosedSkeleton.of(skeleton, positions)
    legs, arms = find_limbs(body)
    if legs is None or arms is None:
        found = "no two legs found" if legs is None else "one pair of limbs found, not two legs and two arms,"
        raise MatchError(f"not a human body: {found} among its {len(skeleton)} joints")
    refuse_other_than_human(body, legs, arms)
    sided = _sided(body, legs, arms)
    legs, arms, certainty = sided.legs, sided.arms, sided.certainty
    marks = {"pelvis": _pelvis(body, legs)}
    for keypoint, found in find_trunk(body, legs, arms).items():
        marks[keypoint] = _mark(body, keypoint, found.joint, found.why, 1.0, found.lead)
    for side, leg, arm in zip(SIDES, legs.sides, arms.sides, strict=True):
        marks |= _limb_marks(body, side, leg, "leg", certainty, legs.lead)
        marks |= _limb_marks(body, side, arm, "arm", certainty, arms.lead)
        if sided.toes:
            marks |= _toe_mark(body, side, leg, certainty)
    return Recognition({k: marks[k] for k in KEYPOINTS if k in marks}, sided.notes, names=skeleton.names)


def apply_override(recognition: Recognition, skeleton: Skeleton, table: Mapping[str, Any]) -> Recognition:
    """Replace keypoints by the joints a user names: `l_hand = "LeftHand"`, or several whose mean is taken.

    Args:
        skeleton: names and tree of the joints.
        table: keypoint → name of a joint, or several names, for the mean of their joints.

    Raises:
        MatchError: a keypoint or a joint that is not known.
    """
    marks = dict(recognition.marks)
    for keypoint, names in table.items():
        if keypoint not in KEYPOINTS:
            raise MatchError(f"unknown keypoint {keypoint!r}; {known(KEYPOINTS, typed=keypoint)}")
        wanted = [names] if isinstance(names, str) else names
        if not (isinstance(wanted, list) and all(isinstance(name, str) for name in wanted)):
            raise MatchError(f'{keypoint} must be "JOINT" or ["JOINT", …], got {names!r}')
        strange = [name for name in wanted if name not in skeleton.names]
        if strange or not wanted:
            what = f"unknown joint {strange[0]!r}" if strange else "no joint given"
            raise MatchError(f"{keypoint}: {what}; {known(skeleton.names)}")
        marks[keypoint] = Mark(tuple(map(skeleton.names.index, wanted)), 1.0, "set by hand")
    return replace(recognition, marks={k: marks[k] for k in KEYPOINTS if k in marks})


def _sided(body: PosedSkeleton, legs: LimbPair, arms: LimbPair) -> "_Sided":
    """Return legs and arms with the left one first: by geometry, or by names where knees or elbows confirm them against the feet."""
    seen, named = votes(body, legs, arms), named_leftness(body, legs)
    heels = seen.feet * named < -HEEL and (seen.knees + seen.elbows) * named > HEEL
    shown = seen.leftness(feet=not heels)
    decided = shown if abs(shown) > OVERRULES or not named else named
    certainty = 1.0 if shown * named > 0 else max(abs(shown), 0.5)
    notes: list[str] = []
    if shown * named < 0 and decided == named:
        notes.append("Feet and knees hint that left and right are swapped; names were followed.")
    if heels:
        notes.append(
            "What hangs below the ankles points backwards by names and knees: heels, not toes; there are no toes."
        )
    arms = arms if same_side_first(body, legs, arms) else _turned(arms)
    if named * decided < 0:
        arms_agree = named_leftness(body, arms) * decided > 0
        whose = "left and right legs" if arms_agree else "left and right"
        notes.append(f"Names of {whose} are swapped: feet and knees point the other way. Geometry was followed.")
    if decided < 0:
        legs, arms = _turned(legs), _turned(arms)
    return _Sided(legs, arms, certainty, not heels, tuple(notes))


@dataclass(frozen=True)
class _Sided:
    """Limbs with the left one first, the certainty of the sides, whether toes were found, and notes."""

    legs: LimbPair
    arms: LimbPair
    certainty: float
    toes: bool
    notes: tuple[str, ...]


def _turned(pair: LimbPair) -> LimbPair:
    return replace(pair, sides=(pair.sides[1], pair.sides[0]))


def _pelvis(body: PosedSkeleton, legs: LimbPair) -> Mark:
    hips = tuple(limb.joints[0] for limb in legs.sides)
    marks = [_mark(body, "hip", joint, "", 1.0) for joint in hips]
    names = " and ".join(repr(body.skeleton.names[joint]) for joint in hips)
    return Mark(hips, min(mark.confidence for mark in marks), f"{names}: the middle of the hips")


def _limb_marks(
    body: PosedSkeleton, side: str, limb: Limb, kind: str, certainty: float, lead: float
) -> dict[str, Mark]:
    part, ratio = LIMBS[kind], limb.upper / limb.lower
    why = f"one of two {kind}s of {len(limb.chain)} joints, upper bone {ratio:.2f} of the lower"
    return {f"{side}_{p}": _mark(body, p, j, why, certainty, lead) for p, j in zip(part, limb.joints, strict=True)}


def _toe_mark(body: PosedSkeleton, side: str, leg: Limb, certainty: float) -> dict[str, Mark]:
    joints = body.toes(leg)
    if not joints:
        return {}
    joint, lead = joints[0], 0.0 if sum(bool(body.children[k]) for k in joints) > 1 else np.inf
    name = body.evidence[joint]
    end = name.tip or (not body.children[joint] and name.agreement("toe") <= 0)
    why = "the foot's end, no toe joint" if end else "the first joint below the ankle"
    mark = _mark(body, "toe", joint, why, certainty, lead)
    # The name of an end is derived from its parent's.
    return {f"{side}_toe": replace(mark, confidence=max(mark.confidence, SILENT * certainty)) if end else mark}


def _mark(body: PosedSkeleton, part: str, joint: int, why: str, certainty: float, lead: float = np.inf) -> Mark:
    """A joint found by tree and geometry, by a lead over the next best place, and by its name.

    The confidence is c (1 − (1 − a)(1 − s)) with the agreement a of the name, the confidence s by tree and geometry alone
    and the certainty c of the side; c s (1 + a) where the name disagrees, a < 0.
    """
    agreement = body.evidence[joint].agreement(_WORD.get(part, part))
    says = "the name agrees" if agreement > 0 else "the name says otherwise" if agreement < 0 else "the name is silent"
    alone = SILENT / (1 + np.exp(-ODDS * lead))
    sure = 1 - (1 - agreement) * (1 - alone) if agreement > 0 else alone * (1 + agreement)
    return Mark((joint,), round(float(certainty * sure), 3), f"{body.skeleton.names[joint]!r}: {why}; {says}")


# The stature of a recognised body, in the unit of its positions.

ADULT_LEG = 0.83
"""Hip to ankle of an adult of 1.70 m [m]."""
_HIP_TO_ANKLE = 0.491
_ANKLE_TO_HEAD = 0.86
"""Shares of the stature: thigh and shank [Winter2009], and ankle to head joint with the back's bones laid end to end."""


def leg_length(recognition: Recognition, positions: Floats) -> float:
    """Hip to knee to ankle, the mean of both legs.

    Args:
        positions: (T, J, 3) of the joints [any unit].
    """
    bones = [
        _length(recognition, positions, *(f"{side}_{part}" for part in ("hip", "knee", "ankle"))) for side in SIDES
    ]
    return sum(bones) / len(bones)


def stature(recognition: Recognition, positions: Floats) -> float:
    """Legs and spine end to end over their share of the stature; from the legs alone for a body without a head.

    Args:
        positions: (T, J, 3) of the joints [any unit].
    """
    leg = leg_length(recognition, positions)
    if "head" not in recognition.marks:
        return leg / _HIP_TO_ANKLE
    spine = [keypoint for keypoint in ("pelvis", "chest", "neck", "head") if keypoint in recognition.marks]
    return (leg + _length(recognition, positions, *spine)) / _ANKLE_TO_HEAD


def _length(recognition: Recognition, positions: Floats, *path: str) -> float:
    """Median length of a path over keypoints."""
    points = [positions[:, list(recognition.marks[keypoint].joints)].mean(axis=1) for keypoint in path]
    steps = [np.linalg.norm(b - a, axis=1) for a, b in pairwise(points)]
    return fsum(np.median(step) for step in steps)  # `sum` rounds otherwise from Python 3.12 on
