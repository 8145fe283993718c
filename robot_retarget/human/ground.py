"""The floor under the human: where it is, and its drift in captures that have no fixed reference."""

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.human.match import Match
from robot_retarget.motion.stance import StanceRule

WINDOW = 0.6
"""A body touches the floor at least once in twice this time: no jump lasts longer [s]."""
DRIFT = 0.1
"""A floor that stays within this share of a leg is taken as level."""


def grounded(positions: Floats, match: Match, fps: float) -> Floats:
    """Keypoints (T, K, 3) with the floor under them brought to z = 0 [m].

    The floor is the lowest foot over the clip. Inertial captures lose their height: there the lowest point of the body
    within `WINDOW` to either side, smoothed, is the floor of each moment. It also makes steps and stairs level.
    """
    z = positions[:, :, 2]
    feet = [k for k, name in enumerate(match.keypoints) if name.endswith(("ankle", "toe"))]
    level = StanceRule().floor_height(z[:, feet].min(axis=1)) if feet else z.min()
    reach = max(1, round(WINDOW * fps))
    floor = uniform_filter1d(minimum_filter1d(z.min(axis=1), 2 * reach + 1, mode="nearest"), reach, mode="nearest")
    if np.ptp(floor) < DRIFT * match.human_leg:
        floor = np.full_like(floor, level)
    return positions - floor[:, None, None] * [0.0, 0.0, 1.0]
