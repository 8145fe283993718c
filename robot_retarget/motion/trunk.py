"""Chest, neck and head: the joints between two legs and two arms, and above the arms."""

import numpy as np

from robot_retarget.arrays import unit
from robot_retarget.motion.limbs import Body, Pair

HEAD_ABOVE_SHOULDERS = 0.2
"""Height of the head joint over the shoulders, in leg lengths (0.16 … 0.21 on the rigs measured; the crown: 0.35)."""


def find_trunk(body: Body, legs: Pair, arms: Pair) -> dict[str, tuple[int, str]]:
    """The joints of chest, neck and head that this body has, with the evidence."""
    height = _heights(body, legs, arms)
    found: dict[str, tuple[int, str]] = {}
    chest = _chest(body, legs, arms, height)
    if chest is not None:
        found["chest"] = chest, "where neck and arms branch off the spine"
    head = _head(body, legs, arms, height, chest)
    if head is not None:
        found["head"] = head, f"{height[head]:.2f} leg lengths above the shoulders"
        neck = next(
            (joint for joint in body.skeleton.above(head)[1:] if body.distance(joint, head) > 0.02 * legs.length), None
        )
        if neck is not None and neck != chest and neck != legs.hub and height[neck] > height[chest or legs.hub]:
            found["neck"] = neck, "the joint below the head"
    return found


def _heights(body: Body, legs: Pair, arms: Pair) -> np.ndarray:
    """(J,) height of every joint over the shoulders along the trunk, in leg lengths."""
    hips, shoulders = body.at(legs, 0).mean(axis=1), body.at(arms, 0).mean(axis=1)
    up = unit(shoulders - hips)
    return np.einsum("fji,fi->fj", body.positions - shoulders[:, None], up).mean(axis=0) / legs.length


def _chest(body: Body, legs: Pair, arms: Pair, height: np.ndarray) -> int | None:
    """The arms' hub, or the first spine joint below where the arms hang from the neck or from above the shoulders."""
    hips = float(np.mean([height[limb.joints[0]] for limb in legs.sides]))
    for joint in body.skeleton.above(arms.hub):
        neck = "neck" in body.senses[joint].parts or height[joint] > 0.0
        if not neck and height[joint] > hips + 0.1:
            return joint
        if joint == legs.hub:
            break
    return None


def _head(body: Body, legs: Pair, arms: Pair, height: np.ndarray, chest: int | None) -> int | None:
    """The joint off the limbs that is called a head, or stands where one is."""
    limbs = legs.below(body) | arms.below(body)
    trunk = set(body.skeleton.above(arms.hub))
    shoulders = [limb.joints[0] for limb in arms.sides]
    best, best_score = None, -5.0
    for joint in range(len(height)):
        if joint in limbs or joint in trunk or chest not in (None, *body.skeleton.above(joint)):
            continue
        aside = abs(body.distance(joint, shoulders[0]) - body.distance(joint, shoulders[1])) / legs.length
        score = (
            -0.5 * ((height[joint] - HEAD_ABOVE_SHOULDERS) / 0.08) ** 2
            - 10 * aside
            + 3 * body.senses[joint].agreement("head")
            - 3 * body.senses[joint].tip
            - 0.5 * (not body.children[joint])
            + 0.5 * (len(body.children[joint]) > 1)
            - 0.08 * len(body.skeleton.above(joint))
        )
        if score > best_score:
            best, best_score = joint, score
    return best
