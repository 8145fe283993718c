"""Contacts of the hands that the human makes and the robot keeps.

A human contact is a pair hand–hand, hand–head or hand–leg whose normalised distance is below its threshold. The robot keeps it
if its distance is at most the human's plus 0.04. A contact is false if the robot is below the threshold and the human more than
0.04 above it.

    recall = kept / human contacts        F1 = 2 kept / (2 kept + false + lost)

Unit: 1. Range: 0 to 1; None where the clip has no contact. Source: contact preservation as in OmniRetarget, on the body itself.
"""

import numpy as np

from robot_retarget.score.figure import Figure, Measure, Value
from robot_retarget.score.reach import closeness, pairs_of
from robot_retarget.score.subject import Subject

NEAR = {"hand": 0.13, "head": 0.22, "knee": 0.14, "hip": 0.10, "pelvis": 0.10}
"""Normalised distance of a hand to each keypoint below which the human touches it [-]."""
SLACK = 0.04
"""How much farther the robot may be [-]."""
TOUCHED = ("head", "l_hip", "r_hip", "l_knee", "r_knee", "pelvis")


def measure(subject: Subject) -> tuple[Value, ...]:
    """Recall, F1 and the frames in which the human makes any contact."""
    pair = subject.pair
    assert pair is not None
    named = [("l_hand", "r_hand"), *((f"{side}_hand", other) for side in "lr" for other in TOUCHED)]
    ends = [ends for ends in named if pair.has(*ends)]
    if not ends:
        return None, None, 0
    columns = pairs_of(pair)
    chosen = [columns.index(tuple(sorted(map(pair.index, two)))) for two in ends]  # type: ignore[arg-type]
    human, robot = (every[:, chosen] for every in closeness(pair))
    near = np.array([NEAR[other.split("_")[-1]] for _, other in ends])
    touching, kept = human < near, robot < human + SLACK
    if not touching.any():
        return None, None, 0
    false = int(((robot < near) & (human > near + SLACK)).sum())
    hit, lost = int((touching & kept).sum()), int((touching & ~kept).sum())
    return hit / (hit + lost), 2 * hit / (2 * hit + false + lost), int(touching.any(axis=1).sum())


MEASURE = Measure(
    (
        Figure("contact_recall", "", 3, "contacts of the hands that the robot keeps", "higher", 1.0),
        Figure("contact_f1", "", 3, "the same, false contacts counted (F1)", "higher", 1.0),
        Figure("contact_frames", "frames", 0, "frames in which the human makes a contact", "neither"),
    ),
    measure,
    human=True,
)
