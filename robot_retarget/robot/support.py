"""The support of a robot: the convex hull of the points that carry it, and the plane on which they push.

Feet on steps have no common floor. Their zero moment point is taken on the virtual plane through the contacts (Sardain and
Bessonnet, Forces acting on a biped robot, IEEE Transactions on Systems, Man, and Cybernetics A 34(5), 2004):

    p = o + n × M_o / (F · n),   M_o = M − o × F

with F, M the contact wrench about the world's origin, o a point and n the normal of the plane. Contacts on the plane that push
along n give their weighted mean, which lies in their convex hull; on one floor p is the zero moment point. Seen from above,
plane and floor have the same hull, so margins are measured there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull

from robot_retarget.base.arrays import Floats, cross, unit
from robot_retarget.base.errors import MatchError
from robot_retarget.robot.anatomy import Anatomy
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.scene.geoms import filled

# The feet of a robot: the bodies that may stand on the floor, and the corners of their soles.

CORNER_NAMES = ("front left", "front right", "rear left", "rear right")
CORNERS = len(CORNER_NAMES)
LEAST_SOLE = 0.01
"""Least length and width of a sole [m]; a shorter sole has no clear heading. Half and double give the same soles of
eight robots."""
NONE = Points(np.zeros(0, int), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Feet:
    """The feet and their soles."""

    names: tuple[str, ...]
    """F names, `l` and `r`; none where the robot is no humanoid."""
    bodies: tuple[frozenset[int], ...]
    """F: the bodies of each foot, toes too."""
    soles: Points
    """The points on which all feet stand, K in all."""
    owner: np.ndarray
    """(K,) the place of the foot that each sole point belongs to."""
    corners: Points
    """Four of each foot, that span its sole."""

    @property
    def filled(self) -> "Feet":
        """The feet with points in rows all over their soles: on a step, any part may carry."""
        if not self.names:
            return self
        offsets = filled(self.corners.offsets.reshape(-1, CORNERS, 3))
        owner = np.repeat(np.arange(len(offsets)), offsets.shape[1])
        return replace(self, soles=Points(self.corners.bodies[CORNERS * owner], offsets.reshape(-1, 3)), owner=owner)

    @property
    def all_bodies(self) -> list[int]:
        """Bodies of any foot."""
        return sorted(set().union(*self.bodies))


def feet_of(robot: Robot) -> Feet:
    """The recognised feet; empty for a robot that is no humanoid."""
    try:
        anatomy = recognise(robot)
        treads = anatomy.treads
    except MatchError:
        anatomy, treads = None, {}
    names = tuple(treads)
    bodies = tuple(with_toes(robot, {int(b) for b in treads[name].bodies}) for name in names)
    if anatomy is None or not names:
        return Feet((), (), NONE, np.zeros(0, int), NONE)
    points = together([treads[name] for name in names])
    corners = together([sole_corners(anatomy, name) for name in names])
    owner = np.repeat(np.arange(len(names)), [len(treads[name].bodies) for name in names])
    return Feet(names, bodies, points, owner, corners)


def together(parts: list[Points]) -> Points:
    """Return the points of several parts, one after the other."""
    points = [NONE, *parts]
    return Points(np.concatenate([p.bodies for p in points]), np.concatenate([p.offsets for p in points]))


def with_toes(robot: Robot, foot: set[int]) -> frozenset[int]:
    """A foot's bodies with all that hang on them."""
    for body in range(1, robot.model.nbody):  # parents come before their children
        if robot.model.body_parentid[body] in foot or robot.model.body_weldid[body] in foot:
            foot.add(body)
    return frozenset(foot)


def sole_corners(anatomy: Anatomy, foot: str) -> Points:
    """Return the corners of the contact area of a foot, in the order of `CORNER_NAMES`.

    A foot that stands on a point or a line has the heading of its frame; a small rectangle along this heading replaces
    it.

    Args:
        anatomy: soles and frames of the robot.
        foot: `l` or `r`.
    """
    body, axes = anatomy.frames[f"{foot}_foot"]
    along = anatomy.treads[foot].offsets @ axes
    low, middle, half = along[:, 2].min(), (along.min(0) + along.max(0)) / 2, np.ptp(along, axis=0) / 2
    (back, right, _), (front, left, _) = (middle + way * np.maximum(half, LEAST_SOLE / 2) for way in (-1, 1))
    corners = np.array([[front, left, low], [front, right, low], [back, left, low], [back, right, low]])
    return Points(np.full(CORNERS, body), corners @ axes.T)


UP = (0.0, 0.0, 1.0)
"""z, as in MuJoCo's worlds."""


@dataclass(frozen=True)
class Polygon:
    """A convex support {x : A x ≤ b}, b shrunk towards its middle."""

    normals: Floats
    """(E, 2) outward unit normals."""
    bounds: Floats
    """(E,) [m]."""
    middle: Floats
    """(2,) [m]."""

    def shrunk(self, keep: float) -> "Polygon":
        """Return the same shape, scaled by `keep` about its middle."""
        inner = self.normals @ self.middle
        return Polygon(self.normals, inner + keep * (self.bounds - inner), self.middle)

    def margin(self, point: Floats) -> float:
        """Return the distance of a point (2,) inside the edges, negative outside [m]."""
        return float((self.bounds - self.normals @ point).min())


def support(corners: Floats) -> Polygon:
    """Return the convex hull of points (N, 3) or (N, 2) on the floor [m]."""
    flat = corners[:, :2]
    hull = ConvexHull(flat)
    vertices = flat[hull.vertices]
    edges, area = _unique(hull.equations), hull.volume
    turned = np.roll(vertices, -1, axis=0)
    cross = vertices[:, 0] * turned[:, 1] - turned[:, 0] * vertices[:, 1]
    middle = ((vertices + turned) * cross[:, None]).sum(0) / (6 * area)
    return Polygon(edges[:, :2], -edges[:, 2], middle)


def _unique(equations: Floats) -> Floats:
    """Return the edges of a hull, without edges collinear with their neighbour."""
    rounded = np.round(equations, 9)
    return equations[np.sort(np.unique(rounded, axis=0, return_index=True)[1])]


@dataclass(frozen=True, eq=False)
class Planes:
    """The plane through the contacts of a robot, over T frames."""

    places: Floats
    """(T, 3) a point of it [m]."""
    normals: Floats
    """(T, 3) unit normals, pointing up."""
    surfaces: Floats
    """(T, 3) mean unit normals of the surfaces that carry: those of a step point up, the plane over it is tilted."""

    def points(self, wrench: Floats) -> Floats:
        """Return (T, 3) zero moment points on the plane [m].

        Args:
            wrench: (T, 6) force [N] and moment about the world's origin [N m] of all contacts.
        """
        force, moment = wrench[:, :3], wrench[:, 3:] - cross(self.places, wrench[:, :3])
        return self.places + cross(self.normals, moment) / (force * self.normals).sum(axis=1, keepdims=True)


def level_planes(frames: int, height: float = 0.0) -> Planes:
    """Return the planes of a level floor [m]."""
    up = np.tile(UP, (frames, 1))
    return Planes(height * up, up.copy(), up)


def joined(planes: Sequence[Planes]) -> Planes:
    """Return the planes of consecutive frames."""
    return Planes(*(np.concatenate([getattr(each, name) for each in planes]) for name in vars(planes[0])))


def planes_through(contacts: Sequence[Floats], normals: Sequence[Floats]) -> Planes:
    """Return the planes that fit the contacts best.

    Args:
        contacts: of each frame, points (P, 3) that carry [m]; none of a frame in the air.
        normals: (P, 3) of the surfaces there.
    """
    planes = level_planes(len(contacts))
    for t, (points, ups) in enumerate(zip(contacts, normals, strict=True)):
        if len(points):
            planes.places[t], planes.normals[t] = _fitted(points)
            planes.surfaces[t] = unit(ups.mean(axis=0))
    return planes


def _fitted(points: Floats) -> tuple[Floats, Floats]:
    """Return middle (3,) and normal (3,) of the plane z = a x + b y + c nearest to points (N, 3); level across a line of points."""
    middle = points.mean(axis=0)
    slope, *_ = np.linalg.lstsq(points[:, :2] - middle[:2], points[:, 2] - middle[2], rcond=1e-6)
    return middle, unit(np.append(-slope, 1.0))
