"""Whether a body with two legs and two arms is a human one."""

import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, unit
from robot_retarget.base.errors import MatchError
from robot_retarget.human.recognition.limbs import LimbPair, PosedSkeleton

ARM_TO_LEG = (0.35, 1.3)
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
