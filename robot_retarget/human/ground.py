"""The floor under the human, and its drift in captures without a fixed reference."""

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.rule import JOINTS, lowest_over_time
from robot_retarget.human.match import Match

DRIFT = 0.1
"""A floor whose height varies by less is level [leg lengths]."""


def floor_under(positions: Floats, match: Match, fps: float) -> Floats:
    """Return the height (T,) of the floor [m]; 0 where the source knows its floor.

    The floor is the lowest foot of the clip. Heights of inertial captures drift: there the floor of each frame is the lowest
    point of the body within `WINDOW` to either side, smoothed. This also removes steps and stairs.

    Args:
        positions: (T, K, 3) keypoints [m].
        match: keypoints that human and robot share.
        fps: frames per second [1/s].
    """
    if match.recognition.ankle_height is not None:
        return np.zeros(len(positions))
    z, lowest = positions[:, :, 2], lowest_over_time(positions[:, :, 2], fps)
    feet = [k for k, name in enumerate(match.keypoints) if name.endswith(("ankle", "toe"))]
    level = JOINTS.floor_height(z[:, feet].min(axis=1)) if feet else z.min()
    return np.full_like(lowest, level) if np.ptp(lowest) < DRIFT * match.human_leg else lowest
