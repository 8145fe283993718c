"""Contact points of a foot: those that can be its lowest, and those that carry it."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import ALIGNED, Floats, unit
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.limbs import sole_cloud
from robot_retarget.robot.links import Links

SOLE_DIRECTIONS = 8
SOLE_TILTS = (0.05, 0.5, 1.1, 1.5)
"""A sole is kept as its extreme points in this many directions around, at these angles under the horizon [rad]; the
first on the flat part only. With half as many directions a sole of the OP3 loses 6.5 mm, with twice as many points of
ToddlerBot come 3.5 mm lower; half of the angles moves the lowest points of a humanoid by 8 mm, double by 3 mm."""
TREAD = 0.0005
"""Solid points within this height above the lowest one carry a flat foot [m]: of eight robots half takes 15 cm from the
tread of the H1, and double adds 2 mm to that of the G1."""
EVEN = 0.9986
"""Least cosine (3°) between the normals of facets of one face, and between a level sole and the floor [-]."""


def flat_footed(links: Links, feet: list[int]) -> Links:
    """Return the robot in its reference pose, with its ankles turned so that flat soles are level.

    Args:
        feet: links of the feet.
    """
    robot = links.robot
    qpos = np.array(robot.model.qpos0)
    for foot in feet:
        face, ankle = _flat_face(links.surface(foot)), links.axes_along(links.path(foot))[-2:]
        if face is None or -face[2] > EVEN or not ankle:
            continue
        turn = Rotation.align_vectors(np.array([[0.0, 0.0, -1.0]]), face[None])[0].as_rotvec()
        angles = np.linalg.lstsq(np.array([axis.direction for axis in ankle]).T, turn)[0]
        qpos[[robot.model.jnt_qposadr[axis.joint] for axis in ankle]] += angles
    return links if np.array_equal(qpos, robot.model.qpos0) else Links(robot, qpos)


def _flat_face(cloud: Floats) -> Floats | None:
    """(3,) the outward normal of the largest face under points (P, 3), None where none is under them."""
    try:
        hull = ConvexHull(cloud)
    except (QhullError, ValueError):  # a point, or all points in one plane
        return None
    normals, corners = hull.equations[:, :3], cloud[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    down = np.flatnonzero(-normals[:, 2] > ALIGNED)
    alike = normals[down] @ normals.T > EVEN
    if not down.size:
        return None
    face = alike[(alike @ areas).argmax()]
    return unit(areas[face] @ normals[face])


def sole(standing: Links, foot: int, surface: Floats) -> Points:
    """The points of a sole that can be its lowest when the foot rolls: extremes in evenly spread directions, once.

    Args:
        foot: link of the foot.
        surface: (P, 3) points of the foot [m].
    """
    azimuth = _all_around()
    ways = [[[np.cos(a) * np.cos(t), np.sin(a) * np.cos(t), -np.sin(t)] for a in azimuth] for t in SOLE_TILTS]
    flat, rim, below = sole_cloud(surface), ways[0], np.concatenate(ways[1:])
    corners = np.vstack(
        [surface[np.unique((surface @ np.transpose(below)).argmax(0))], flat[(flat @ np.transpose(rim)).argmax(0)]]
    )
    return _on_foot(standing, foot, corners)


def tread(standing: Links, foot: int) -> Points:
    """The points of the solid surface that touch the floor when the foot stands flat: the extremes all around.

    Args:
        foot: link of the foot.
    """
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
