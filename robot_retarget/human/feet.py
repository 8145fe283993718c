"""Orientation of the human's feet: level in the frames in which an upright human stands on them with the ankles lowest.

Positions do not show the roll of a foot. A source with rotations gives the rotation of the ankle, times the constant that
makes the foot level in those frames.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats, cross, lengths, unit
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.rotations import ARBITRARY, UP, constant_between, own_rotation
from robot_retarget.robot.axes import BENT

FEET = ("l_foot", "r_foot")
FLAT_SHARE = 0.1
"""Share of the frames, those with the lowest ankle, in which a standing foot is flat [-]: on tiptoe the ankle is higher."""
TWISTED = np.cos(ARBITRARY)
"""Largest cosine of the angle between the left of a twisted foot and the axis of its knee [-]."""
UPRIGHT = 0.9
"""A human is upright while the head is above this share of its largest height [-]."""


def foot_constants(
    motion: Motion, match: Match, x: dict[str, Floats], floor: Floats, contacts: dict[str, Bools]
) -> dict[str, Floats]:
    """Return the constant (3, 3) of each foot; the flat foot corrects one that is on its toes throughout.

    Args:
        x: (T, 3) per keypoint, over level ground [m].
        floor: (T,) its height in the source [m].
    """
    top = x[next(k for k in ("head", "chest", *match.keypoints) if k in x)][:, 2]
    upright = np.asarray(top >= UPRIGHT * top.max())
    sides = [side for side in "lr" if {f"{side}_{k}" for k in ("knee", "ankle", "toe")} <= x.keys()]
    toes = {side: contacts[side][:, 0] for side in sides}
    flat = {side: _flat(x[f"{side}_ankle"][:, 2] + floor, toes[side], upright) for side in sides}
    drops = {side: _drop((x[f"{side}_toe"] - x[f"{side}_ankle"])[flat[side]]) for side in sides}
    least = min((drops[side] for side in sides if toes[side].any()), default=np.inf)
    found = {}
    for side in sides:
        found[side] = _levelled(motion, match, side, x, flat[side])
        if drops[side] - least > BENT:
            found[side] = found[side] @ Rotation.from_euler("y", drops[side] - least).as_matrix()
    return found


def untwisted(feet: Floats, legs: Floats) -> Floats:
    """Return the axes (T, F, 3, 3) of feet, with the axis of the knee as left where no ankle could turn that far from it.

    Captures lose the roll of a foot that points along its shin, and some turn it right over.

    Args:
        feet: (T, F, 3, 3) axes.
        legs: (T, F, 3, 3) places of hip, knee and ankle [m].
    """
    thigh, shin = legs[..., 1, :] - legs[..., 0, :], legs[..., 2, :] - legs[..., 1, :]
    across = cross(thigh, shin)
    bend, along = lengths(across), np.vecdot(feet[..., 1], across)
    turned = (along < TWISTED * bend) & (bend > BENT * lengths(thigh) * lengths(shin))
    if not turned.any():
        return feet
    y = unit(across)
    ahead = unit(feet[..., 0] - (feet[..., 0] * y).sum(-1, keepdims=True) * y)
    return np.where(turned[..., None, None], np.stack([ahead, y, cross(ahead, y)], axis=-1), feet)


def _flat(height: Floats, stands: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Return (T,) the frames in which a foot is flat: its ankle is lowest, and mostly an upright human stands on its toes.

    A lying human may have the lowest ankles, with the toes up. Then the frames are chosen among those of an upright stance.
    """
    low, bears = height <= np.quantile(height, FLAT_SHARE), stands & upright
    if bears[low].mean() > 0.5:
        return low
    frames = next(some for some in (bears, stands, np.ones_like(stands)) if some.any())
    return frames & (height <= np.quantile(height[frames], FLAT_SHARE))


def _drop(along: Floats) -> float:
    """Return the median angle by which the toes are below the ankle, from ankle-to-toe vectors (N, 3) [rad]."""
    return float(np.median(np.arcsin(-unit(along)[:, 2])))


def _levelled(motion: Motion, match: Match, side: str, x: dict[str, Floats], flat: np.ndarray) -> Floats:
    """Return the constant (3, 3) that makes a foot level, its toes straight ahead, in the frames (T,) in which it is flat."""
    knee, ankle, toe = (x[f"{side}_{k}"] for k in ("knee", "ankle", "toe"))
    ahead = unit((toe - ankle)[flat] * [1, 1, 0])
    level = np.stack([ahead, np.cross(UP, ahead), np.broadcast_to(UP, ahead.shape)], axis=2)
    own = own_rotation(motion, match, f"{side}_foot")
    measured = foot_axes(knee, ankle, toe) if own is None else own
    return constant_between(measured[flat], level)


def foot_axes(knee: Floats, ankle: Floats, toe: Floats) -> Floats:
    """(T, 3, 3) along the foot, across shin and foot, and square to both.

    Args:
        knee: (T, 3) [m].
        ankle: (T, 3) [m].
        toe: (T, 3) [m].
    """
    along, y = unit(toe - ankle), unit(np.cross(knee - ankle, toe - ankle))
    return np.stack([along, y, np.cross(along, y)], axis=2)
