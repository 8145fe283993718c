"""The human as a figure of capsules: thick where bones are long, with a head."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.tools.view.staging import Staging

COLOUR = (0.95, 0.55, 0.25, 1.0)
"""Red, green, blue, alpha, 0 … 1."""
THICKNESS = 0.22
"""A capsule's radius as a part of its bone's length,"""
BOUNDS = (0.018, 0.029)
"""within these parts of the height."""
HEAD = 0.055
"""Radius of the head as a part of the height."""

ALONE = 0.8
"""A limb this much shorter than all others has no twin on the other side [-]."""


@dataclass(frozen=True, eq=False)
class StickFigure:
    """Limbs from point to point; a limb whose points are equal is a sphere."""

    limbs: Ints
    """(L, 2) indices of points."""
    radii: Floats
    """(L,) [m]."""


def stick_figure(staging: Staging) -> StickFigure:
    """Bones as capsules and the head as a sphere."""
    if not staging.human.size:
        return StickFigure(staging.bones, np.zeros(0))
    lengths = np.linalg.norm(np.diff(staging.human[:, staging.bones], axis=2)[:, :, 0], axis=-1).mean(0)
    least, most = BOUNDS
    flesh = np.clip(THICKNESS * lengths, least * staging.height, most * staging.height)
    head = _head(staging, lengths)
    return StickFigure(np.append(staging.bones, [[head, head]], axis=0), np.append(flesh, HEAD * staging.height))


def _head(staging: Staging, lengths: Floats) -> int:
    """The end of the one limb that is shorter than all others; where those are two, the point that stands highest most of
    the time: a raised hand does not, but who lies down has no head that does.
    """
    limbs = sorted((_to_the_branch(staging.bones, lengths, int(end)), int(end)) for end in _ends(staging.bones))
    if len(limbs) > 1 and limbs[0][0] < ALONE * limbs[1][0]:
        return limbs[0][1]
    return int(np.median(staging.human[..., 2], axis=0).argmax())


def _ends(bones: Ints) -> Ints:
    """The points that one bone ends in."""
    return np.flatnonzero(np.bincount(bones.ravel()) == 1)


def _to_the_branch(bones: Ints, lengths: Floats, end: int) -> float:
    """How long the limb is from its end to where it branches off [m]."""
    here, length, way = end, 0.0, np.flatnonzero((bones == end).any(axis=1)).tolist()
    while len(way) == 1:
        bone = way[0]
        here, length = int(bones[bone].sum() - here), length + float(lengths[bone])
        way = [k for k in np.flatnonzero((bones == here).any(axis=1)).tolist() if k != bone]
    return length
