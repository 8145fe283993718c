"""Figures of distances between pairs of keypoints, over the path τ between them: ‖x_u − x_v‖/τ_uv, 0 (together) to 1 (stretched).

distance_err and near_err: difference of the human's and the robot's

    | ‖x_u − x_v‖/τ_uv − ‖y_u − y_v‖/τ'_uv |        unit: 1, range: 0 to 1

over all pairs, and over those that are near in the human: ‖x_u − x_v‖/τ_uv < 0.35. Source: the normalisation of [Mucherino2017].

contact_recall and contact_f1: contacts of the hands that the human makes and the robot keeps. A human contact is a pair hand–hand,
hand–head or hand–leg whose distance is below its threshold. The robot keeps it if its distance is at most the human's plus 0.04. A contact
is false if the robot is below the threshold and the human more than 0.04 above it.

    recall = kept / human contacts        F1 = 2 kept / (2 kept + false + lost)        unit: 1, range: 0 to 1

None where the clip has no contact. Source: contact preservation as in OmniRetarget, on the body itself.
"""

import numpy as np

from robot_retarget.human.match import NEAR
from robot_retarget.scores.figure import Figure, Value, measures
from robot_retarget.scores.subject import Subject

TOUCH = {"hand": 0.13, "head": 0.22, "knee": 0.14, "hip": 0.10, "pelvis": 0.10}
"""Normalised distance of a hand to each keypoint below which the human touches it [-]."""
SLACK = 0.04
"""How much farther the robot may be [-]."""
TOUCHED = ("head", "l_hip", "r_hip", "l_knee", "r_knee", "pelvis")


@measures(
    Figure("distance_err_mean", "", 4, "error of normalised distances over all pairs of keypoints", most=1.0),
    Figure("near_err", "", 4, "the same over pairs that are near in the human", most=1.0),
    human=True,
)
def distances(subject: Subject) -> tuple[Value, ...]:
    """The mean over all pairs, and over near pairs."""
    human, robot = subject.pair.closeness(*np.triu_indices(len(subject.pair.match.keypoints), 1))
    error, near = np.abs(human - robot), human < NEAR
    return error.mean(), error[near].mean() if near.any() else None


@measures(
    Figure("contact_recall", "", 3, "contacts of the hands that the robot keeps", "higher", 1.0),
    Figure("contact_f1", "", 3, "the same, false contacts counted (F1)", "higher", 1.0),
    Figure("contact_frames", "frames", 0, "frames in which the human makes a contact", "neither"),
    human=True,
)
def contacts(subject: Subject) -> tuple[Value, ...]:
    """Recall, F1 and the frames in which the human makes any contact."""
    pair = subject.pair
    named = [("l_hand", "r_hand"), *((f"{side}_hand", other) for side in "lr" for other in TOUCHED)]
    ends = [ends for ends in named if pair.has(*ends)]
    if not ends:
        return None, None, 0
    human, robot = pair.closeness(*([pair.index(k) for k in side] for side in zip(*ends, strict=True)))
    near = np.array([TOUCH[other.split("_")[-1]] for _, other in ends])
    touching, kept = human < near, robot < human + SLACK
    if not touching.any():
        return None, None, 0
    false = int(((robot < near) & (human > near + SLACK)).sum())
    hit, lost = int((touching & kept).sum()), int((touching & ~kept).sum())
    return hit / (hit + lost), 2 * hit / (2 * hit + false + lost), int(touching.any(axis=1).sum())
