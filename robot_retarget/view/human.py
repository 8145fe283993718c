"""The human as a figure of capsules: thick where bones are long, with a head."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.view.staging import Staging

COLOUR = (0.95, 0.55, 0.25, 1.0)
"""Red, green, blue, alpha, 0 … 1."""
THICKNESS = 0.22
"""A capsule's radius as a part of its bone's length,"""
BOUNDS = (0.018, 0.029)
"""within these parts of the height."""
HEAD = 0.055
"""Radius of the head as a part of the height."""


@dataclass(frozen=True, eq=False)
class Figure:
    """What is drawn at each moment, from point to point; a sphere where both are one."""

    limbs: Ints
    """(L, 2) indices of points."""
    radii: Floats
    """(L,) [m]."""


def figure(staging: Staging) -> Figure:
    """Bones as capsules and the head as a sphere.

    The head is the point that stands highest most of the time: a raised hand does not.
    """
    if not staging.human.size:
        return Figure(staging.bones, np.zeros(0))
    lengths = np.linalg.norm(np.diff(staging.human[:, staging.bones], axis=2)[:, :, 0], axis=-1).mean(0)
    least, most = BOUNDS
    flesh = np.clip(THICKNESS * lengths, least * staging.height, most * staging.height)
    head = int(np.median(staging.human[..., 2], axis=0).argmax())
    return Figure(np.append(staging.bones, [[head, head]], axis=0), np.append(flesh, HEAD * staging.height))
