"""The vocabulary that a human and a robot share: eighteen keypoints and the tree that joins them.

Both sides are recognised in these words (`human.recognition`, `robot.recognise`); a body may lack some of them, and
then its tree closes over the gap (`parents_within`).
"""

from collections.abc import Collection

import numpy as np

from robot_retarget.base.arrays import Ints, frozen

SIDES = ("l", "r")

PARENTS: dict[str, str] = {"chest": "pelvis", "neck": "chest", "head": "neck"}
for _side in SIDES:
    PARENTS |= {
        f"{_side}_shoulder": "chest",
        f"{_side}_elbow": f"{_side}_shoulder",
        f"{_side}_hand": f"{_side}_elbow",
        f"{_side}_hip": "pelvis",
        f"{_side}_knee": f"{_side}_hip",
        f"{_side}_ankle": f"{_side}_knee",
        f"{_side}_toe": f"{_side}_ankle",
    }

KEYPOINTS: tuple[str, ...] = ("pelvis", *PARENTS)
"""Every keypoint, parents before children. `pelvis` is the middle of the hips, `hand` the wrist, `toe` the toe base."""

ARM = ("shoulder", "elbow", "hand")
LEG = ("hip", "knee", "ankle", "toe")


def parents_within(present: Collection[str]) -> dict[str, str]:
    """The tree over the keypoints a body has: each one's nearest ancestor that is present."""
    tree = {}
    for keypoint in KEYPOINTS:
        if keypoint in present and keypoint in PARENTS:
            parent = PARENTS[keypoint]
            while parent not in present and parent in PARENTS:
                parent = PARENTS[parent]
            if parent in present:
                tree[keypoint] = parent
    return tree


def parent_indices(keypoints: tuple[str, ...]) -> Ints:
    """Return (K,) the index of each keypoint's parent among them, −1 at the root."""
    tree = parents_within(keypoints)
    return frozen([keypoints.index(tree[k]) if k in tree else -1 for k in keypoints], np.int64)


def mirrored(keypoint: str) -> str:
    """The keypoint of the other side: `l_hand` ↔ `r_hand`; the middle ones are their own."""
    swap = {"l_": "r_", "r_": "l_"}
    return swap[keypoint[:2]] + keypoint[2:] if keypoint[:2] in swap else keypoint
