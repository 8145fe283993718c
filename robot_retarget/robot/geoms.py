"""Which geoms of a robot collide, and where they are in N configurations."""

import copy
import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
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
