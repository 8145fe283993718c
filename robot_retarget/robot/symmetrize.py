"""Symmetrize points measured on meshes.

The joint axes of most robots mirror each other exactly; their meshes differ by tenths of a millimetre and more. Toes, hands,
head and soles are measured on meshes, so each is replaced by the mean of itself and its mirror image. A motion and its
mirror image then pose the same problem. Sides that differ by more stay unchanged.
"""

from collections.abc import Mapping

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.keypoints import mirrored

SLIGHT = 0.02
"""Sides that differ by less than this share of the body, or of the foot, are symmetrized, and hinges whose mirrored lines
do are counterparts [-]."""


def symmetric_places(places: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return keypoints (3,) [m], each the mean of itself and of the mirror image of its counterpart.

    Args:
        left: (3,) unit vector from the right to the left.
    """
    paired = [k for k in places if mirrored(k) != k and mirrored(k) in places]
    if not paired:
        return dict(places)
    middle = float(np.median([places[k] @ left for k in paired]))
    size = float(np.ptp(np.array(list(places.values())), axis=0).max())
    found = {}
    for keypoint, place in places.items():
        seen = places.get(mirrored(keypoint), place)
        image = seen + 2 * (middle - seen @ left) * left
        found[keypoint] = (place + image) / 2 if np.linalg.norm(image - place) < SLIGHT * size else place
    return found


def symmetric_soles(clouds: Mapping[str, Floats], ankles: Mapping[str, Floats], left: Floats) -> dict[str, Floats]:
    """Return the points of both feet (P, 3) [m], each joined with the mirror image of the other foot.

    Args:
        clouds: per foot `l`, `r` points of its surface in the standing pose.
        ankles: per foot (3,), the origin of its mirror image [m].
    """
    if len(clouds) < 2:
        return dict(clouds)
    own = {side: clouds[side] - ankles[side] for side in "lr"}
    image = {a: own[b] - 2 * (own[b] @ left)[:, None] * left for a, b in ("lr", "rl")}
    ends = [np.array([cloud.min(axis=0), cloud.max(axis=0)]) for cloud in (own["l"], image["l"])]
    if np.abs(ends[0] - ends[1]).max() > SLIGHT * np.ptp(ends[0], axis=0).max():
        return dict(clouds)
    return {side: ankles[side] + np.vstack([own[side], image[side]]) for side in "lr"}
