"""The floor under the human, and its drift in captures without a fixed reference."""

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.human.stance import StanceRule

WINDOW = 0.6
"""A body touches the floor at least once in twice this time, because no jump lasts longer [s]."""
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
    z = positions[:, :, 2]
    feet = [k for k, name in enumerate(match.keypoints) if name.endswith(("ankle", "toe"))]
    level = StanceRule().floor_height(z[:, feet].min(axis=1)) if feet else z.min()
    reach = max(1, round(WINDOW * fps))
    floor = uniform_filter1d(minimum_filter1d(z.min(axis=1), 2 * reach + 1, mode="nearest"), reach, mode="nearest")
    return np.full_like(floor, level) if np.ptp(floor) < DRIFT * match.human_leg else floor
