"""The geoms of one robot in N configurations, and the places at which they are near each other."""

from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints


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
