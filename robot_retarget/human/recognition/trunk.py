"""Chest, neck and head: the joints between two legs and two arms, and above the arms."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import unit
from robot_retarget.human.recognition.limbs import SAME, LimbPair, PosedSkeleton

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
