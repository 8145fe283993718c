"""Distances between the floor z = 0 and links other than feet.

Feet have separate rows. Hands, knees and the back must stay above the floor. A link that lies flat rests on several
points, so each geom gives its extreme points straight down and in four directions slightly to the side.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.links import local_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.placed import GeomDistances, Placed

FLOOR = -1
"""Geom id of the floor."""
_ASIDE = 0.3
_BELOW = np.array([[0, 0, -1], [_ASIDE, 0, -1], [-_ASIDE, 0, -1], [0, _ASIDE, -1], [0, -_ASIDE, -1]], dtype=float)
_BEFORE = np.tri(len(_BELOW), k=-1, dtype=bool)
_UP = np.array([0.0, 0.0, 1.0])
_GEOM = mujoco.mjtGeom
_AROUND = np.arange(64) * np.pi / 32
"""Angles of points on the rim of a cylinder; the lowest of them is within 0.0012 radii of the lowest point of the rim."""


class Floor:
    """Geoms that must stay above the floor, and the points at which they are near it."""

    reach: float
    geoms: Ints

    def __init__(self, robot: Robot, model: mujoco.MjModel, feet: frozenset[int], reach: float):
        """Watch the solid geoms of all links but the `feet` within `reach` [m]."""
        solid = [g for link, own in solid_geoms(robot).items() if link not in feet for g in own]
        self.reach, self.geoms = reach, np.array(sorted(solid), dtype=np.int64)
        reached = np.asarray(model.geom_rbound)[self.geoms]
        self.reached: Floats = np.where(reached > 0, reached, np.inf)
        """(G,) largest distances of the geoms' points from their origins [m]; MuJoCo gives 0 for geoms without an end."""
        self.shapes: list[tuple[Floats, float]] = [_rounded(model, int(geom)) for geom in self.geoms]

    def near(self, placed: Placed) -> list[GeomDistances]:
        """Return the points of each geom within reach of the floor."""
        return [self._points(k, frames, placed) for k, frames, _ in self._below(placed, self.reach)]

    def depth(self, placed: Placed) -> Floats:
        """Return the depths (N,) of the deepest points under the floor [m], 0 if all points are above it."""
        depth = np.zeros(len(placed))
        for _, frames, lowest in self._below(placed, 0.0):
            depth[frames] = np.maximum(depth[frames], -lowest)
        return depth

    def _below(self, placed: Placed, height: float) -> Iterator[tuple[int, Ints, Floats]]:
        """Yield which geoms come lower than a height [m], in which configurations, and how low they come.

        Balls about the geoms leave few of them, whose own points decide.
        """
        origin = placed.positions.take(self.geoms, axis=1)[:, :, 2]
        near = np.flatnonzero(origin - self.reached < height)
        if not near.size:
            return
        frames, geoms = np.divmod(near, len(self.geoms))
        for k in sorted(set(geoms.tolist())):
            own, (points, radius) = frames[geoms == k], self.shapes[k]
            up = placed.turns[own, self.geoms[k], 6:]
            lowest = (up @ points.T).min(axis=1) + origin[own, k] - radius
            low = np.flatnonzero(lowest < height)
            if low.size:
                yield k, own[low], lowest[low]

    def _points(self, k: int, frames: Ints, placed: Placed) -> GeomDistances:
        """Return the outermost places of a geom in configurations (F,) that are within reach, each once.

        They are outermost straight down and a little aside.
        """
        (points, radius), geom = self.shapes[k], self.geoms[k]
        turn, origin = placed.turns[frames, geom].reshape(-1, 3, 3), placed.positions[frames, geom]
        outermost = (_BELOW @ turn @ points.T).argmax(axis=2)
        place = points[outermost] @ turn.mT + (origin - radius * _UP)[:, None]
        again = ((outermost[:, :, None] == outermost[:, None]) & _BEFORE).any(axis=2)
        frame, which = (~again & (place[..., 2] < self.reach)).nonzero()
        place, count = place[frame, which], len(frame)
        pairs, up = np.array([[FLOOR, geom]]).repeat(count, axis=0), _UP[None].repeat(count, axis=0)
        return GeomDistances(frames[frame], place[:, 2].copy(), pairs, place, up)


def _rounded(model: mujoco.MjModel, geom: int) -> tuple[Floats, float]:
    """A geom as the hull of balls: their centres (P, 3) in its frame and their radius [m]."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _GEOM.mjGEOM_SPHERE:
        return np.zeros((1, 3)), float(size[0])
    if kind == _GEOM.mjGEOM_CAPSULE:
        return np.array([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]]), float(size[0])
    if kind == _GEOM.mjGEOM_CYLINDER:
        return _rims(size), 0.0
    points = local_points(model, geom)
    return points if kind != _GEOM.mjGEOM_MESH else points[_on_hull(model, int(model.geom_dataid[geom]))], 0.0


def _on_hull(model: mujoco.MjModel, mesh: int) -> Ints:
    """Which vertices of a mesh are on its convex hull; MuJoCo found it for those that collide."""
    start = int(model.mesh_graphadr[mesh])
    if start < 0:
        first, number = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        try:
            return np.sort(ConvexHull(model.mesh_vert[first : first + number]).vertices).astype(np.int64)
        except QhullError:  # it is flat
            return np.arange(number)
    # A graph begins with how many vertices and faces there are; then come, per vertex, its edges' place and its number.
    count = int(model.mesh_graph[start])
    return np.sort(model.mesh_graph[start + 2 + count : start + 2 + 2 * count]).astype(np.int64)


def _rims(size: Floats) -> Floats:
    """Points on both rims of a cylinder of a radius and half a length."""
    rim = np.stack([size[0] * np.cos(_AROUND), size[0] * np.sin(_AROUND), np.full(len(_AROUND), size[1])], axis=1)
    return np.concatenate([rim, rim * [1, 1, -1]])
