"""Distances between the floor z = 0 and links other than feet.

Feet have separate rows. Hands, knees and the back must stay above the floor. A link that lies flat rests on several
points, so each geom gives its extreme points straight down and in four directions slightly to the side.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.arrays import Floats, Ints
from robot_retarget.robot.geoms import solid_geoms
from robot_retarget.robot.links import local_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.placed import GeomDistances, Placed, joined

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
        self.middle, self.half = np.asarray(model.geom_aabb)[self.geoms].reshape(-1, 2, 3).transpose(1, 0, 2)
        self.shapes: list[tuple[Floats, float]] = [_rounded(model, int(geom)) for geom in self.geoms]

    def near(self, placed: Placed) -> GeomDistances:
        """Return the points within reach of the floor."""
        return joined([self._points(k, frames, placed) for k, frames in self._below(placed, self.reach)])

    def depth(self, placed: Placed) -> Floats:
        """Return the depths (N,) of the deepest points under the floor [m], 0 if all points are above it."""
        depth = np.zeros(len(placed))
        for k, frames in self._below(placed, 0.0):
            lowest = self._places(k, frames, placed)[0][..., 2].min(axis=1)
            depth[frames] = np.maximum(depth[frames], -lowest)
        return depth

    def _below(self, placed: Placed, height: float) -> Iterator[tuple[int, Ints]]:
        """Yield which geoms are in boxes that come lower than a height [m], in which configurations.

        Of an axis u, the box comes down to z + u·c − |u|·h.
        """
        up = placed.turns.take(self.geoms, axis=1)[:, :, 6:]
        lowest = np.einsum("ngi,gi->ng", up, self.middle) - np.einsum("ngi,gi->ng", np.abs(up), self.half)
        below = lowest + placed.positions.take(self.geoms, axis=1)[:, :, 2] < height
        for k in np.flatnonzero(below.any(axis=0)).tolist():
            yield k, np.flatnonzero(below[:, k])

    def _points(self, k: int, frames: Ints, placed: Placed) -> GeomDistances:
        """Return the outermost places of a geom in configurations (F,), each once, that are within reach."""
        place, outermost = self._places(k, frames, placed)
        again = ((outermost[:, :, None] == outermost[:, None]) & _BEFORE).any(axis=2)
        frame, which = (~again & (place[..., 2] < self.reach)).nonzero()
        place, pair = place[frame, which], np.array([[FLOOR, self.geoms[k]]])
        count = len(frame)
        return GeomDistances(
            frames[frame], place[:, 2].copy(), pair.repeat(count, 0), place, _UP[None].repeat(count, 0)
        )

    def _places(self, k: int, frames: Ints, placed: Placed) -> tuple[Floats, Ints]:
        """The outermost places of a geom in configurations (F,), straight down and a little aside (F, 5, 3) [m], and which they are."""
        points, radius = self.shapes[k]
        geom = self.geoms[k]
        turn, origin = placed.turns[frames, geom].reshape(-1, 3, 3), placed.positions[frames, geom]
        outermost = (_BELOW @ turn @ points.T).argmax(axis=2)
        return points[outermost] @ turn.mT + (origin - radius * _UP)[:, None], outermost


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
