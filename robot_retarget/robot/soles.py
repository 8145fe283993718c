"""The points of a foot that matter to the floor: those that can be its lowest, and those that carry it."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.limbs import sole_cloud
from robot_retarget.robot.links import Links

SOLE_DIRECTIONS = 8
SOLE_TILTS = (0.5, 1.1, 1.5)
"""A sole is kept as its extreme points in this many directions around, at these angles under the horizon [rad]."""
TREAD = 0.0005
"""What is solid of a foot and this near to its lowest carries it where it stands flat [m]."""


def sole(standing: Links, foot: int, surface: Floats) -> Points:
    """The points of a sole that can be its lowest when the foot rolls: extremes in evenly spread directions, once."""
    cloud = surface[surface[:, 2] < surface[:, 2].min() + max(0.02, 0.3 * float(np.ptp(surface[:, 2])))]
    azimuth = _all_around()
    ways = [[np.cos(a) * np.cos(t), np.sin(a) * np.cos(t), -np.sin(t)] for t in SOLE_TILTS for a in azimuth]
    flat = sole_cloud(surface)
    rim = [[np.cos(a), np.sin(a), -0.05] for a in azimuth]
    corners = np.vstack(
        [cloud[np.unique((cloud @ np.transpose(ways)).argmax(0))], flat[(flat @ np.transpose(rim)).argmax(0)]]
    )
    return _on_foot(standing, foot, corners)


def tread(standing: Links, foot: int) -> Points:
    """The points of the solid surface that touch the floor when the foot stands flat: the extremes all around."""
    cloud = standing.surface(foot)
    flat = cloud[cloud[:, 2] < cloud[:, 2].min() + TREAD]
    azimuth = _all_around()
    return _on_foot(standing, foot, flat[(flat[:, :2] @ np.stack([np.cos(azimuth), np.sin(azimuth)])).argmax(0)])


def _all_around() -> Floats:
    return (np.arange(SOLE_DIRECTIONS) + 0.5) * 2 * np.pi / SOLE_DIRECTIONS


def _on_foot(standing: Links, foot: int, places: Floats) -> Points:
    """Each of the places (P, 3) once, fixed to the foot."""
    once = np.unique(places.round(5), axis=0)
    return Points(np.full(len(once), foot), np.array([standing.local(foot, place) for place in once]))
