"""Colliding geoms of a robot: their poses in N configurations, and those near boxes and the floor."""

import copy
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Floats, Ints, cross, unit
from robot_retarget.robot.links import local_points
from robot_retarget.robot.model import Robot

# Which geoms of a robot collide, and which pairs of links may touch.

Table = dict[tuple[int, int], list[tuple[int, int]]]
"""Pairs of geoms by pair of links."""


def collision_geoms(robot: Robot) -> dict[int, list[int]]:
    """Return the colliding geoms of every link: by contact type, or from an explicit pair.

    A model in which no two links can touch uses its visual geoms (`shapes_stand_in`).
    """
    model = robot.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    touching[[*model.pair_geom1, *model.pair_geom2]] = True
    return _by_link(model, touching | shapes_stand_in(robot))


def solid_geoms(robot: Robot) -> dict[int, list[int]]:
    """Return the solid geoms of every link: the colliding ones, or all geoms of a link without any."""
    return _by_link(robot.model, np.ones(robot.model.ngeom, dtype=bool)) | collision_geoms(robot)


def shapes_stand_in(robot: Robot) -> bool:
    """Return whether visual geoms replace collision geoms: the model has no colliding types and no explicit pair of links."""
    model = robot.model
    link = np.asarray(model.body_weldid)[model.geom_bodyid]
    by_type = ((model.geom_contype | model.geom_conaffinity) != 0) & (link > 0)
    first, second = link[model.pair_geom1], link[model.pair_geom2]
    return not (by_type.any() or ((first > 0) & (second > 0)).any())


def touchable(robot: Robot) -> mujoco.MjModel:
    """Return the model, or a copy in which visual geoms collide if they replace collision geoms."""
    if not shapes_stand_in(robot):
        return robot.model
    model = copy.deepcopy(robot.model)
    own = np.asarray(model.body_weldid)[model.geom_bodyid] > 0
    model.geom_contype[own] = model.geom_conaffinity[own] = 1
    model.body_contype[:] = model.body_conaffinity[:] = (
        np.asarray(model.body_weldid) > 0
    )  # the broad phase uses the types of bodies
    return model


def _by_link(model: mujoco.MjModel, chosen: np.ndarray) -> dict[int, list[int]]:
    link, found = np.asarray(model.body_weldid)[model.geom_bodyid], {}
    for geom in np.flatnonzero(chosen & (link > 0)):
        found.setdefault(int(link[geom]), []).append(int(geom))
    return dict(sorted(found.items()))


def allowed(robot: Robot) -> Table:
    """Return the pairs of geoms (a < b) of every pair of links that pass the model's contact filter."""
    model = robot.model
    link = np.asarray(model.body_weldid)
    carrier = link[model.body_parentid[link]]
    shut = {tuple(sorted((int(code) >> 16, int(code) & 0xFFFF))) for code in model.exclude_signature}
    explicit = {tuple(sorted(map(int, pair))) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    solid = [g for geoms in collision_geoms(robot).values() for g in geoms]
    stand_in = shapes_stand_in(robot)
    listed = explicit | set(itertools.combinations(sorted(solid), 2))
    table: Table = {}
    for a, b in sorted(listed):
        bodies = int(model.geom_bodyid[a]), int(model.geom_bodyid[b])
        first, second = sorted(int(link[body]) for body in bodies)
        related = carrier[first] == second or carrier[second] == first
        types = (model.geom_contype[a] & model.geom_conaffinity[b]) | (
            model.geom_contype[b] & model.geom_conaffinity[a]
        )
        let_through = (types or stand_in) and not related and tuple(sorted(bodies)) not in shut
        if first != second and first > 0 and (let_through or (a, b) in explicit):
            table.setdefault((first, second), []).append((a, b))
    return table


# The geoms of one robot in N configurations, and the places at which they are near each other.


@dataclass(frozen=True, eq=False)
class GeomDistances:
    """C places where geoms are near each other in N configurations."""

    frame: Ints
    """(C,) the configuration, 0 … N − 1."""
    distance: Floats
    """(C,) [m], negative inside."""
    geoms: Ints
    """(C, 2)."""
    place: Floats
    """(C, 3) half way between the surfaces [m]."""
    normal: Floats
    """(C, 3) from the first geom to the second."""

    def __len__(self) -> int:
        return len(self.distance)

    def __add__(self, other: "GeomDistances") -> "GeomDistances":
        return joined([self, other]) if len(other) else self

    def __getitem__(self, rows: Ints) -> "GeomDistances":
        return GeomDistances(*(column.take(rows, axis=0) for column in vars(self).values()))

    def in_order(self) -> "GeomDistances":
        """Return the places of one configuration after those of another."""
        ordered = (self.frame[1:] >= self.frame[:-1]).all()
        return self if ordered else self[np.argsort(self.frame, kind="stable")]


NOWHERE = GeomDistances(np.empty(0, int), np.empty(0), np.empty((0, 2), int), np.empty((0, 3)), np.empty((0, 3)))


def joined(parts: list[GeomDistances]) -> GeomDistances:
    """Return the places of several parts, one after the other."""
    if len(parts) == 1:
        return parts[0]
    columns = zip(*(vars(part).values() for part in parts or [NOWHERE]), strict=True)
    return GeomDistances(*map(np.concatenate, columns))


@dataclass(frozen=True, eq=False)
class Placed:
    """Where the geoms and the dofs of a robot are in N configurations, by MuJoCo."""

    positions: Floats
    """(N, G, 3) of geoms [m]."""
    turns: Floats
    """(N, G, 9) of geoms, rows of a matrix one after the other."""
    centres: Floats
    """(N, B, 3) of mass of the subtrees, which the motions of dofs refer to [m]."""
    dofs: Floats
    """(N, nv, 6) motions: turn and travel."""

    @classmethod
    def empty(cls, model: mujoco.MjModel, count: int) -> "Placed":
        """Return the arrays to fill in for a number of configurations."""
        sizes = (model.ngeom, 3), (model.ngeom, 9), (model.nbody, 3), (model.nv, 6)
        return cls(*(np.empty((count, *size)) for size in sizes))

    @classmethod
    def at(cls, model: mujoco.MjModel, data: mujoco.MjData, qpos: Floats) -> "Placed":
        """Return configurations (N, nq), with `data` at the last of them."""
        placed = cls.empty(model, len(qpos))
        for k, q in enumerate(qpos):
            data.qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            for column, view in zip(vars(placed).values(), views(data), strict=True):
                column[k] = view
        return placed

    @classmethod
    def of(cls, data: mujoco.MjData) -> "Placed":
        """Return the one configuration of `data`."""
        return cls(*(view[None] for view in views(data)))

    def __len__(self) -> int:
        return len(self.positions)

    def rows(self, rows: slice) -> "Placed":
        """Return the arrays of some of the configurations."""
        return Placed(*(column[rows] for column in vars(self).values()))

    def matrices(self, frame: Ints, geom: Ints) -> Floats:
        """Return the rotations (C, 3, 3) of geoms (C,) in configurations (C,)."""
        count = self.positions.shape[1]
        return self.turns.reshape(-1, 3, 3).take(frame * count + geom, axis=0)

    def origins(self, frame: Ints, geom: Ints) -> Floats:
        """Return the positions (C, 3) of geoms (C,) in configurations (C,) [m]."""
        count = self.positions.shape[1]
        return self.positions.reshape(-1, 3).take(frame * count + geom, axis=0)


def views(data: mujoco.MjData) -> tuple[Floats, ...]:
    """Return the arrays of `data` that a `Placed` copies."""
    return data.geom_xpos, data.geom_xmat, data.subtree_com, data.cdof


# Places where two boxes are near each other: nearest points and corners, independent of the order of the boxes.
#
# MuJoCo's own contacts of boxes that do not touch yet miss pairs, are off by up to a centimetre, and change when the
# boxes are mirrored. Here the nearest two points come from `mj_geomDistance`. One point alone lets boxes roll about it, so
# the corners near the other box are added: a point p is ‖max(|p| − h, 0)‖ away from a box of half sizes h. Boxes that overlap
# get no corners, because a corner inside a box has no direction out of it.

ON_SURFACE = 1e-9
"""Surfaces this near have no direction between them [m]."""
TOGETHER = 32
"""Configurations in which all boxes are compared with each other at once: their distances stay in the processor's
cache. With 16 and with 64 a boxing OP3 is solved in 1.6 s as well."""
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


class Boxes:
    """Pairs of boxes that may collide, and the places at which they are near each other."""

    model: mujoco.MjModel
    pairs: Ints
    reach: float
    boxes: Ints

    def __init__(self, model: mujoco.MjModel, pairs: Ints, reach: float):
        """Watch pairs of box geoms (N, 2) within `reach` [m]."""
        self.model, self.pairs, self.reach = model, pairs, reach
        self.sizes: Floats = np.array(model.geom_size)
        self.boxes, places = np.unique(pairs, return_inverse=True)
        first, second = places.reshape(-1, 2).T
        # Squared distances of centres; those of pairs that are not watched are never less.
        self.balls: Floats = np.full((len(self.boxes), len(self.boxes)), -1.0)
        self.balls[first, second] = (np.asarray(model.geom_rbound)[pairs].sum(axis=1) + reach) ** 2
        self._data = mujoco.MjData(model)
        self._positions, self._turns = self._data.geom_xpos, self._data.geom_xmat

    def near(self, placed: Placed) -> GeomDistances:
        """Return the places at which boxes are near each other."""
        frame, pairs, turn, offset = self._candidates(placed)
        if not len(pairs):
            return NOWHERE
        nearest = self._nearest(placed, frame, pairs)
        apart = np.flatnonzero(nearest.distance > ON_SURFACE)
        frame, pairs, turn, offset = (each.take(apart, axis=0) for each in (frame, pairs, turn, offset))
        return nearest[np.flatnonzero(np.abs(nearest.distance) > ON_SURFACE)] + self._corners(
            placed,
            np.concatenate([frame, frame]),
            np.concatenate([pairs, pairs[:, ::-1]]),
            np.concatenate([turn, turn.mT]),
            np.concatenate([offset, -_times(turn.mT, offset)]),
        )

    def _candidates(self, placed: Placed) -> tuple[Ints, Ints, Floats, Floats]:
        """Pairs that no face holds farther apart than the reach, with their configurations.

        Returns also the second box's rotation and centre in the first's axes.
        """
        centres = placed.positions.take(self.boxes, axis=1)
        blocks = range(0, len(centres), TOGETHER)
        near = [first * self.balls.size + self._within_balls(centres[first : first + TOGETHER]) for first in blocks]
        frame, *ends = np.unravel_index(np.concatenate(near), (len(placed), *self.balls.shape))
        one, other = (self.boxes.take(end) for end in ends)
        first, gap = placed.matrices(frame, one).mT, placed.origins(frame, other) - placed.origins(frame, one)
        turn, offset = first @ placed.matrices(frame, other), _times(first, gap)
        size, other_size, spread = self.sizes.take(one, axis=0), self.sizes.take(other, axis=0), np.abs(turn)
        apart = np.maximum(
            np.abs(offset) - size - _times(spread, other_size),
            np.abs(_times(turn.mT, offset)) - other_size - _times(spread.mT, size),
        ).max(axis=1)
        keep = (apart < self.reach).nonzero()[0]
        return tuple(each.take(keep, axis=0) for each in (frame, np.stack([one, other], axis=1), turn, offset))

    def _within_balls(self, centres: Floats) -> Ints:
        """Return the places in (N, B, B) of the pairs whose balls are within reach, for centres (N, B, 3) of the boxes."""
        squares, ones = (centres * centres).sum(axis=2, keepdims=True), np.ones((*centres.shape[:2], 1))
        left = np.concatenate([squares, ones, centres], axis=2)
        right = np.concatenate([ones, squares, -2 * centres], axis=2)
        return np.flatnonzero(left @ right.mT < self.balls)

    def _nearest(self, placed: Placed, frame: Ints, pairs: Ints) -> GeomDistances:
        """The nearest points of every pair; boxes that just touch have no normal."""
        ends, distance, last = np.zeros((len(pairs), 6)), np.empty(len(pairs)), -1
        for k, (at, (a, b)) in enumerate(zip(frame.tolist(), pairs.tolist(), strict=True)):
            if at != last:
                self._positions[:], self._turns[:], last = placed.positions[at], placed.turns[at], at
            distance[k] = mujoco.mj_geomDistance(self.model, self._data, a, b, 2 * self.reach, ends[k])
        ends = ends.reshape(-1, 2, 3)
        way = (ends[:, 1] - ends[:, 0]) / np.where(np.abs(distance) > ON_SURFACE, distance, np.inf)[:, None]
        for k in np.flatnonzero(distance <= ON_SURFACE):
            distance[k], way[k] = self._overlap(placed, frame[[k, k]], pairs[k])
        return GeomDistances(frame, distance, pairs, ends.mean(axis=1), way)

    def _overlap(self, placed: Placed, frame: Ints, pair: Ints) -> tuple[float, Floats]:
        """Return the largest gap of two boxes along the normals of their faces and pairs of edges [m], negative inside, and that normal.

        `mj_geomDistance` is 0 for some boxes whose faces overlap by millimetres, and up to 0.1 mm off for others.
        """
        axes, way = placed.matrices(frame, pair).mT, np.diff(placed.origins(frame, pair), axis=0)[0]
        # Of parallel edges any direction will do.
        normals = np.concatenate([*axes, unit(cross(axes[0][:, None], axes[1]).reshape(-1, 3) + 1e-8)])
        half = [np.abs(normals @ own.T) @ self.sizes[box] for own, box in zip(axes, pair, strict=True)]
        gap = np.abs(normals @ way) - half[0] - half[1]
        best = int(gap.argmax())
        return float(gap[best]), normals[best] * np.sign(normals[best] @ way)

    def _corners(self, placed: Placed, frame: Ints, pairs: Ints, turn: Floats, offset: Floats) -> GeomDistances:
        """Corners of the second box of each pair near the surface of the first."""
        corner = (_CORNERS * self.sizes[pairs[:, 1], None]) @ turn.mT + offset[:, None]
        out = np.maximum(np.abs(corner) - self.sizes[pairs[:, 0], None], 0.0)
        distance = np.sqrt((out * out).sum(axis=2))
        pair, which = ((distance > ON_SURFACE) & (distance < self.reach)).nonzero()
        corner, out, distance, frame = corner[pair, which], out[pair, which], distance[pair, which], frame[pair]
        slope = out * np.sign(corner) / distance[:, None]
        axes, origin = placed.matrices(frame, pairs[pair, 0]), placed.origins(frame, pairs[pair, 0])
        place = origin + _times(axes, corner - 0.5 * distance[:, None] * slope)
        return GeomDistances(frame, distance, pairs[pair], place, _times(axes, slope))


def _times(matrix: Floats, vector: Floats) -> Floats:
    """(N, 3, 3) · (N, 3)."""
    return (matrix @ vector[..., None])[..., 0]


# Distances between the floor z = 0 and links other than feet.
#
# Feet have separate rows. Hands, knees and the back must stay above the floor. A link that lies flat rests on several
# points, so each geom gives its extreme points straight down and in four directions slightly to the side.

FLOOR_GEOM = -1
"""Geom id of the floor."""
_RIM = 0.3
_BELOW = np.array([[0, 0, -1], [_RIM, 0, -1], [-_RIM, 0, -1], [0, _RIM, -1], [0, -_RIM, -1]], dtype=float)
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
        pairs, up = np.array([[FLOOR_GEOM, geom]]).repeat(count, axis=0), _UP[None].repeat(count, axis=0)
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
