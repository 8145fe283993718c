"""Corners of soles over time: their heading, and their flat placement on the floor."""

import numpy as np

from robot_retarget.base.arrays import Floats, bearing, leftward, unit

TOE, HEEL = [0, 1], [2, 3]
_LEFT, _RIGHT = [0, 2], [1, 3]


def lengths(corners: Floats) -> Floats:
    """Return (…, 2) vectors from mid-heel to mid-toes of soles (…, 4, 3), along the floor [m]."""
    xy = corners[..., :2]
    return (xy[..., 0, :] + xy[..., 1, :] - xy[..., 2, :] - xy[..., 3, :]) / 2


def heading(soles: Floats) -> Floats:
    """Return the common heading (…) of F soles (…, F, 4, 3), from x towards y [rad]."""
    return bearing(lengths(soles).sum(axis=-2))


def flattened(corners: Floats) -> Floats:
    """Return corners (…, 4, 3) laid flat on the floor: same middle, same heading, same shape."""
    middle = corners.mean(axis=-2, keepdims=True)
    ahead = unit(lengths(corners))[..., None, :]
    left = leftward(ahead)
    length, width = (
        np.linalg.norm(corners[..., one, :] - corners[..., other, :], axis=-1).mean(axis=-1)[..., None, None] / 2
        for one, other in ((TOE, HEEL), (_LEFT, _RIGHT))
    )
    signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    flat = middle[..., :2] + signs[:, :1] * length * ahead + signs[:, 1:] * width * left
    return np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1)


def laid(corners: Floats, place: Floats, normal: Floats) -> Floats:
    """Return corners (4, 3) laid flat on a plane, with the heading and the middle they have seen from above; as `raised`."""
    return raised(flattened(corners), place, normal)


def turned(corners: Floats, angle: Floats, corner: int) -> Floats:
    """Return corners (T, 4, 3) turned about the vertical through one of them.

    Args:
        angle: (T,) from x towards y [rad].
        corner: the one that stays.
    """
    away = corners[..., :2] - corners[:, [corner], :2]
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    level = corners[:, [corner], :2] + cos * away + sin * leftward(away)
    return np.concatenate([level, corners[..., 2:]], axis=2)


def raised(corners: Floats, place: Floats, normal: Floats) -> Floats:
    """Return corners (…, 4, 3) on the floor moved straight up to a plane.

    Args:
        place: (3,) a point of the plane [m].
        normal: (3,) its unit normal, pointing up.
    """
    height = place[2] - (corners[..., :2] - place[:2]) @ normal[:2] / normal[2]
    return corners + height[..., None] * [0.0, 0.0, 1.0]
