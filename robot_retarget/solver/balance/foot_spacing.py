"""Two adjacent soles: their heading, their distance, and their separation.

Soles are their corners (T, F, 4, 3) in the order of `soles.CORNER_NAMES`, the left foot first.
"""

import numpy as np

from robot_retarget.base.arrays import Floats, leftward, unit
from robot_retarget.graph.soles import lengths

GAP = 0.6
"""Least gap between two soles, as a share of the gap in the robot's own stand."""


def spread(corners: Floats, own: Floats) -> Floats:
    """Return (T, 2, 4, 3) both feet, moved apart if they are nearer than in the stand `own`.

    A human moves narrow feet past each other closely; large soles cannot pass.
    """
    width = across(own[None])[0]
    missing = np.maximum(width - across(corners), GAP * gaps(own[None])[0] - gaps(corners))
    aside = np.maximum(missing, 0.0)[:, None] / 2 * left(corners)
    apart = corners.copy()
    apart[:, 0, :, :2] += aside[:, None]
    apart[:, 1, :, :2] -= aside[:, None]
    return apart


def gaps(corners: Floats) -> Floats:
    """Return (T,) gaps between two soles (T, 2, 4, 3), negative for overlap: the widest along their edges [m]."""
    flat = corners[..., :2]
    along = unit(lengths(corners))
    axes = np.concatenate([along, leftward(along)], axis=1)
    extent = np.einsum("tfci,tai->tafc", flat, axes)
    lower, upper = extent.min(axis=3), extent.max(axis=3)
    return np.maximum(lower[..., 0] - upper[..., 1], lower[..., 1] - upper[..., 0]).max(axis=1)


def across(corners: Floats) -> Floats:
    """Return (T,) the distance of the first foot to the left of the second, relative to their common heading [m]."""
    return ((corners[:, 0] - corners[:, 1]).mean(axis=1)[:, :2] * left(corners)).sum(axis=1)


def left(corners: Floats) -> Floats:
    """Return (T, 2) unit vectors to the left of the common heading of both feet (T, F, 4, 3)."""
    return leftward(ahead(corners))


def ahead(corners: Floats) -> Floats:
    """Return (T, 2) unit vectors along the common heading of both feet (T, F, 4, 3)."""
    return unit(lengths(corners).sum(axis=1))
