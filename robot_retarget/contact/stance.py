"""How a robot stands: which feet touch the ground, and how far inside its support it is balanced.

The margin of a point is its distance to the nearest edge of the convex hull of the sole points that carry.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, leftward
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.soles import contacts_of
from robot_retarget.robot.dynamics import momenta, tread
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import Feet, Planes, feet_of, level_planes, planes_through
from robot_retarget.scene.geoms import RESTING, SolidGround
from robot_retarget.trajectory import Trajectory

DOWN = RESTING
"""Sole points of a touching foot this near to the floor carry it [m]."""
COLLINEAR = 1e-9
"""Corners nearer than this to a line are on it [m]: rounding."""
SMOOTH = 0.05
"""Of the momenta of a plan [s]: of a walk on the OP3 the 99th percentile of the torques is 0.77 of the limits with
half, 0.61 with this and 0.37 with double; on the G1 0.30 with all."""


@dataclass(frozen=True, eq=False)
class Stance:
    """F feet, K sole points, over N frames of a plan or states of a simulation."""

    feet: Feet
    times: Floats
    """(N,) [s]."""
    touching: np.ndarray
    """(N, F) whether a foot is on the ground: by the record of a plan, by the contacts of a simulation."""
    points: Floats
    """(N, K, 3) sole points [m], heights above the ground."""
    down: np.ndarray
    """(N, K) whether a sole point carries its foot."""
    com: Floats
    """(N, 2) the centre of mass, seen from above [m]."""
    zmp: Floats
    """(N, 2) the zero moment point [m], NaN where the robot hardly touches the ground."""
    com_margin: Floats
    zmp_margin: Floats
    """(N,) inside the support [m], negative outside, NaN without support."""


def planned_stance(robot: Robot, trajectory: Trajectory, contacts: ContactRecord | None = None) -> Stance | None:
    """How the robot would stand if it followed the trajectory with its lowest sole point of every frame on the ground.

    None for a robot without recognised feet or a free root.

    Args:
        robot: the robot that moves.
        trajectory: of T frames.
        contacts: of its feet; by default those of the trajectory.
    """
    ground = SolidGround(trajectory.scene)
    feet = feet_of(robot) if ground.level else feet_of(robot).filled
    if not feet.names or not robot.floating:
        return None
    places = world_points(robot, feet.soles, trajectory.qpos)
    points = places.copy()
    points[..., 2] = ground.over(places)
    above = points[..., 2].min(axis=1)
    points[..., 2] -= above[:, None]
    touching = (contacts or contacts_of(trajectory, robot)).down
    down = touching[:, feet.owner] & (points[..., 2] < 2 * DOWN)
    on_ground = trajectory.qpos.copy()
    on_ground[:, robot.root_address + 2] -= above
    places[..., 2] -= above[:, None]
    com = momenta(robot, on_ground, np.zeros((len(on_ground), robot.model.nv)))[0]
    pushed = tread(robot, on_ground, trajectory.fps, SMOOTH, contact_planes(places, down, ground)).point
    margin = margins(np.stack([com[:, :2], pushed]), points[..., :2], down)
    times = np.arange(len(trajectory)) / trajectory.fps
    return Stance(feet, times, touching, points, down, com[:, :2], pushed, margin[0], margin[1])


def contact_planes(points: Floats, down: np.ndarray, ground: SolidGround, floor: float = 0.0) -> Planes:
    """Return the planes through the points (N, K, 3) of soles that are down (N, K); on nothing but the floor, the floor [m]."""
    if ground.level:
        return level_planes(len(points), floor)
    normals = ground.under(points)[1]
    return planes_through(
        [own[on] for own, on in zip(points, down, strict=True)],
        [own[on] for own, on in zip(normals, down, strict=True)],
    )


def margins(places: Floats, corners: Floats, down: np.ndarray) -> Floats:
    """How far inside the hull of its frame's corners that are down each place is.

    Args:
        places: (M, N, 2) [m].
        corners: (N, K, 2) [m].
        down: (N, K).

    Returns:
        (M, N) [m], negative beyond an edge, NaN without support.
    """
    found = np.full(places.shape[:2], np.nan)
    for k in np.flatnonzero(down.any(1)):
        found[:, k] = _inside(corners[k, down[k]], places[:, k])
    return found


def _inside(corners: Floats, places: Floats) -> Floats:
    """Return (M,) distances of places (M, 2) inside the hull of corners (K, 2): its edges have no corner to their right."""
    way = corners - corners[:, None]
    size = np.hypot(way[..., 0], way[..., 1])
    inward = leftward(way) / np.maximum(size, COLLINEAR)[..., None]
    start = (inward * corners[:, None]).sum(axis=-1)
    over = inward @ corners.T - start[..., None]
    edges = (size > COLLINEAR) & (over.min(axis=-1) > -COLLINEAR)
    if not (over[edges] > COLLINEAR).any():  # a point or a line has no inside
        return -_from_line(corners, places)
    return (inward[edges] @ places.T - start[edges][:, None]).min(axis=0)


def _from_line(corners: Floats, places: Floats) -> Floats:
    """Return distances (M,) of places (M, 2) from the line segment that spans corners (N, 2) [m]."""
    first = corners[np.linalg.norm(corners - corners[0], axis=1).argmax()]
    last = corners[np.linalg.norm(corners - first, axis=1).argmax()]
    way = last - first
    share = np.clip((places - first) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    return np.linalg.norm(places - first - share[:, None] * way, axis=1)
