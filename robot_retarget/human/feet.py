"""Orientation of the human's feet: level in the frames in which an upright human stands on them with the ankles lowest.

Positions do not show the roll of a foot. A source with rotations gives the rotation of the ankle, times the constant that
makes the foot level in those frames.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, unit
from robot_retarget.human.contacts import contact_schedule
from robot_retarget.human.ground import grounded
from robot_retarget.human.match import Match
from robot_retarget.human.rotations import ARBITRARY, UP, constant_between, own_rotation
from robot_retarget.human.skeleton import Motion
from robot_retarget.robot.axes import BENT

FLAT_SHARE = 0.1
"""Share of the frames, those with the lowest ankle, in which a standing foot is flat [-]: on tiptoe the ankle is higher."""
UPRIGHT = 0.9
"""A human is upright while the head is above this share of its largest height [-]."""


def feet_frames(motion: Motion, match: Match, x: dict[str, Floats]) -> dict[str, Floats]:
    """Return the axes (T, 3, 3) of both feet; the flat foot corrects one that is on its toes throughout.

    Args:
        motion: the human.
        match: keypoints that human and robot share.
        x: (T, 3) per keypoint [m].
    """
    level = grounded(match.human_positions(motion), match, motion.fps)
    top = level[:, match.index(next(k for k in ("head", "chest", *match.keypoints) if k in match.keypoints)), 2]
    stands, upright = (
        contact_schedule(level, match, motion.fps, motion.contacts),
        np.asarray(top >= UPRIGHT * top.max()),
    )
    sides = [side for side in "lr" if {f"{side}_{k}" for k in ("knee", "ankle", "toe")} <= x.keys()]
    toes = {side: stands[side][:, 0] for side in sides}
    flat = {side: _flat(x[f"{side}_ankle"][:, 2], toes[side], upright) for side in sides}
    drops = {side: _drop((x[f"{side}_toe"] - x[f"{side}_ankle"])[flat[side]]) for side in sides}
    least = min((drops[side] for side in sides if toes[side].any()), default=np.inf)
    feet = {}
    for side in sides:
        knee, ankle, toe = (x[f"{side}_{k}"] for k in ("knee", "ankle", "toe"))
        foot = _foot(motion, match, side, knee, ankle, toe, flat[side])
        if drops[side] - least > BENT:
            foot = foot @ Rotation.from_euler("y", drops[side] - least).as_matrix()
        hip = x.get(f"{side}_hip")
        feet[side] = foot if hip is None else _untwisted(foot, hip, knee, ankle)
    return feet


def _untwisted(foot: Floats, hip: Floats, knee: Floats, ankle: Floats) -> Floats:
    """Return the axes of a foot, with the axis of the knee as its left where no ankle could turn that far from it.

    Captures lose the roll of a foot that points along its shin, and some turn it right over.
    """
    across = np.cross(unit(knee - hip), unit(ankle - knee))
    y = unit(across)
    ahead = foot[:, :, 0] - (foot[:, :, 0] * y).sum(1, keepdims=True) * y
    along = np.stack([unit(ahead), y, np.cross(unit(ahead), y)], axis=2)
    turned = (foot[:, :, 1] * y).sum(1) < np.cos(ARBITRARY)
    return np.where((turned & (np.linalg.norm(across, axis=1) > BENT))[:, None, None], along, foot)


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


def _foot(
    motion: Motion, match: Match, side: str, knee: Floats, ankle: Floats, toe: Floats, flat: np.ndarray
) -> Floats:
    """Return the axes of a foot that is level, with its toes straight ahead, in the frames (T,) in which it is flat."""
    along = toe - ankle
    ahead = unit(along[flat] * [1, 1, 0])
    level = np.stack([ahead, np.cross(UP, ahead), np.broadcast_to(UP, ahead.shape)], axis=2)
    own = own_rotation(motion, match, f"{side}_ankle")
    seen = foot_axes(knee, ankle, toe) if own is None else own
    return seen @ constant_between(seen[flat], level)


def foot_axes(knee: Floats, ankle: Floats, toe: Floats) -> Floats:
    """(T, 3, 3) along the foot, across shin and foot, and square to both.

    Args:
        knee: (T, 3) [m].
        ankle: (T, 3) [m].
        toe: (T, 3) [m].
    """
    along, y = unit(toe - ankle), unit(np.cross(knee - ankle, toe - ankle))
    return np.stack([along, y, np.cross(along, y)], axis=2)
