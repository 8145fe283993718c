"""Distances between the floor z = 0 and links other than feet.

Feet have separate rows. Hands, knees and the back must stay above the floor. A link that lies flat rests on several
points, so each geom gives its extreme points straight down and in four directions slightly to the side.
"""

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.arrays import Floats, Ints
from robot_retarget.robot.boxes import GeomDistances
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.links import local_points
from robot_retarget.robot.model import Robot

FLOOR = -1
"""Geom id of the floor."""
_ASIDE = 0.3
_BELOW = np.array([[0, 0, -1], [_ASIDE, 0, -1], [-_ASIDE, 0, -1], [0, _ASIDE, -1], [0, -_ASIDE, -1]], dtype=float)
_UP = np.array([0.0, 0.0, 1.0])
_GEOM = mujoco.mjtGeom
_AROUND = np.arange(64) * np.pi / 32
"""Angles of points on the rim of a cylinder; the lowest of them is within 0.0012 radii of the lowest point of the rim."""


class Floor:
    """Geoms that must stay above the floor, and the points at which they are near it."""

    reach: float
    geoms: Ints

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData, feet: frozenset[int], reach: float):
        """Watch the solid geoms of all links but the `feet` within `reach` [m], at the poses of `data`."""
        solid = [g for link, own in solid_geoms(robot).items() if link not in feet for g in own]
        self.reach, self.geoms = reach, np.array(sorted(solid), dtype=np.int64)
        middle, half = np.asarray(model.geom_aabb)[self.geoms].reshape(-1, 2, 3).transpose(1, 2, 0)
        self.shapes: list[tuple[Floats, float]] = [_rounded(model, int(geom)) for geom in self.geoms]
        # Most steps find nothing near the floor: views and buffers are allocated once.
        self._turns, self._origins = data.geom_xmat, data.geom_xpos
        self._box, self._up = np.concatenate([middle, -half]), np.empty((6, len(self.geoms)))
        self._where = 9 * self.geoms + np.array([[6], [7], [8]]), 3 * self.geoms + 2

    def near(self) -> GeomDistances | None:
        """Return the points within reach of the floor, or None."""
        found = [(k, self._places(k)) for k in self._below(self.reach)]
        if not found:
            return None
        place = np.concatenate([places for _, places in found])
        pairs = np.array([(FLOOR, self.geoms[k]) for k, places in found for _ in places])
        near = GeomDistances(place[:, 2].copy(), pairs, place, np.tile(_UP, (len(place), 1)))
        return near[np.flatnonzero(near.distance < self.reach)]

    def depth(self) -> float:
        """Return the depth of the deepest point under the floor [m], 0 if all points are above it."""
        return -min([0.0, *(float(self._places(k)[:, 2].min()) for k in self._below(0.0))])

    def _below(self, height: float) -> list[int]:
        """Which geoms are in boxes that come lower than a height [m]: of an axis u, z + u·c − |u|·h."""
        turns, heights = self._where
        up = self._turns.take(turns, out=self._up[:3], mode="clip")
        np.abs(up, out=self._up[3:])
        lowest = np.add.reduce(np.multiply(self._up, self._box, out=self._up)) + self._origins.take(heights)
        return [] if lowest.min(initial=np.inf) >= height else np.flatnonzero(lowest < height).tolist()

    def _places(self, k: int) -> Floats:
        """(N, 3) the outermost places of a geom, straight down and a little aside, each once [m]."""
        points, radius = self.shapes[k]
        geom = self.geoms[k]
        turn = self._turns[geom].reshape(3, 3)
        outermost = sorted(set((_BELOW @ turn @ points.T).argmax(axis=1).tolist()))
        return points[outermost] @ turn.T + (self._origins[geom] - radius * _UP)


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
