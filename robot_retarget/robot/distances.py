"""Signed distances between the links of a robot, by the distance engine of the solver."""

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.robot.geoms import Boxes, Floor, GeomDistances, Placed, allowed, joined, touchable, views
from robot_retarget.robot.kinematics import POSED, carrying
from robot_retarget.robot.model import FREE, Robot

# Work on the rows of an array in threads: MuJoCo's functions release the interpreter lock.

LEAST_ROWS = 8
"""Rows of a part at least: a thread begins in the time of one row."""

Done = TypeVar("Done")


def in_parts(work: Callable[[int, slice], Done], count: int, threads: int) -> list[Done]:
    """Return what `work` returns for the parts of `count` rows, in order; every part has its own number and thread.

    Args:
        work: receives the number of a part and its rows.
        count: number of rows.
        threads: number of parts at most.
    """
    parts = max(min(threads, count // LEAST_ROWS), 1)
    rows = [slice(*ends) for ends in pairwise(count * k // parts for k in range(parts + 1))]
    if parts == 1:
        return [work(0, rows[0])]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(work, range(parts), rows))


# Distances between near links, and their Jacobians.
#
# MuJoCo finds the pairs by the model's own contact filter, with margins widened to the reach (it adds the margins of two
# geoms). Its functions run for one configuration after the other; everything else is computed for all configurations at
# once. Pairs of boxes and the floor have their own modules. Pairs that overlap where the robot rests are left out: they
# overlap by construction.

FLOOR_SHARE = 0.4
"""Share of the reach within which the floor is watched [-]: it does not move. Half and double do not change a boxing
OP3."""
TIE = 1e-6
"""Links that overlap deeper at rest are left out [m]: far above the engine's rounding."""
_YZX = [1, 2, 0]
_NONE = np.zeros(0), np.zeros((0, 2), dtype=np.int64)
_KEPT: WeakKeyDictionary[Robot, dict[float, tuple[mujoco.MjModel, mujoco.MjModel]]] = WeakKeyDictionary()


class Separation:
    """Distances of near surfaces of one robot, and their Jacobians by the tangent v."""

    model: mujoco.MjModel
    reach: float
    boxes: Boxes
    seen: Bools

    def __init__(
        self,
        robot: Robot,
        reach: float,
        feet: frozenset[int] | None = None,
    ):
        """Watch geoms within `reach` [m] of each other.

        Args:
            feet: links without rows for the floor, because soles have their own; None for a scene without a floor.
        """
        self.plain, self.model = _models(robot, reach)
        self.reach = reach
        self.places: list[_Places] = [_Places(self.model, self.plain)]
        self.bodies: Ints = np.append(np.asarray(self.model.geom_bodyid), 0)
        """(G + 1,) that geoms belong to; the floor, which comes last, to the world."""
        self.trees: Ints = np.asarray(self.model.body_rootid)[self.bodies]
        carried = carrying(self.model).astype(float)
        self.between: Floats = (carried[None] - carried[:, None]).reshape(-1, self.model.nv)
        """(B², nv) +1 where a dof carries the second of two bodies alone, −1 where it carries the first."""
        solid = _moves(self.model)
        self.counts: Bools = np.logical_and.outer(solid, solid)
        self.rest: Floats = np.full((self.model.ngeom + 1,) * 2, np.inf)
        """(G + 1, G + 1) distance of two geoms at rest [m]; the floor comes last."""
        self.is_box: Bools = np.asarray(self.model.geom_type) == mujoco.mjtGeom.mjGEOM_BOX
        listed = allowed(robot).values() if self.is_box.sum() > 1 else ()
        self._watch(np.array([pair for pairs in listed for pair in pairs], dtype=int).reshape(-1, 2))
        self.floor: Floor | None = None if feet is None else Floor(robot, self.model, feet, FLOOR_SHARE * reach)
        for rest in (robot.neutral(), np.array(robot.model.qpos0)):
            self._learn(self.distances(rest[None]))
        self._learn(self.along(robot.standing()[None])[0], least=0.0)
        self._watch(self.boxes.pairs)

    def along(self, qpos: Floats, threads: int = 1) -> tuple[GeomDistances, Floats]:
        """Return all places where links are near each other or near the floor, in order of the configurations.

        Args:
            qpos: (N, nq).
            threads: number of threads among which MuJoCo's calls are shared.

        Returns:
            C places, and slopes of their distances by v (C, nv).
        """
        placed, parts = self._measured(qpos, threads)
        if self.floor is not None:
            parts += self.floor.near(placed)
        found = joined(parts).in_order()
        return found, self._slopes(placed, found)

    def distances(self, qpos: Floats) -> GeomDistances:
        """Return all places where links are near each other at configurations (N, nq)."""
        return joined(self._measured(qpos)[1])

    def _slopes(self, placed: Placed, found: GeomDistances) -> Floats:
        """Return (C, nv) slopes by v of distances, which are in order of the configurations.

        Along the normal n, a point moves by n·(travel + turn × arm) with every dof that carries its body.
        """
        first, second = found.geoms.T
        centres = placed.centres.reshape(-1, 3).take(found.frame * self.model.nbody + self.trees.take(second), axis=0)
        arm, along = found.place - centres, found.normal
        moment = (arm * along.take(_YZX, 1) - arm.take(_YZX, 1) * along).take(_YZX, 1)
        wrench, slope = np.concatenate([moment, along], axis=1), np.empty((len(found), self.model.nv))
        ends = np.searchsorted(found.frame, np.arange(len(placed) + 1)).tolist()
        for frame, (start, end) in enumerate(pairwise(ends)):
            np.matmul(wrench[start:end], placed.dofs[frame].T, out=slope[start:end])
        slope *= self.between.take(self.bodies.take(first) * self.model.nbody + self.bodies.take(second), axis=0)
        return slope

    def depth(self, qpos: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m], 0 when none overlap."""
        return float(self.overlaps(qpos)[0].max(initial=0.0))

    def overlaps(self, qpos: Floats) -> tuple[Floats, Ints]:
        """Return depths (C,) [m] and geoms (C, 2) of overlapping links at a configuration (nq,)."""
        return self.overlaps_along(qpos[None])[0]

    def overlaps_along(self, qpos: Floats, threads: int = 1) -> list[tuple[Floats, Ints]]:
        """Return the same at configurations (N, nq), by MuJoCo's contacts.

        This model has no margins: contacts take a third of the time, and a twentieth for robots of many boxes.
        """
        found = in_parts(lambda k, rows: self._touching(self.places[k], qpos[rows]), len(qpos), self._ready(threads))
        return [each for part in found for each in part]

    def _touching(self, places: "_Places", qpos: Floats) -> list[tuple[Floats, Ints]]:
        """Return the overlaps at configurations (N, nq), one after the other."""
        data, every = places.touching, []
        for q in qpos:
            data.qpos[:] = q
            mujoco.mj_kinematics(self.plain, data)
            mujoco.mj_collision(self.plain, data)
            every.append(self._overlapping(data.contact) if data.ncon else _NONE)
        return every

    def _overlapping(self, found: Any) -> tuple[Floats, Ints]:
        """Return depths and geoms of the contacts that count."""
        if found.dist.min(initial=0.0) >= 0:
            return _NONE
        first, second = found.geom.T
        counted = np.flatnonzero(self.counts[first, second] & (found.dist < 0))
        return -found.dist[counted], found.geom[counted]

    def floor_penetration(self, qpos: Floats) -> Floats:
        """Return the depths (N,) of links other than feet under the floor at configurations (N, nq) [m], 0 if all are above it."""
        if self.floor is None:
            return np.zeros(len(qpos))
        here = self.places[0]
        if len(qpos) > 1:
            return self.floor.depth(Placed.at(self.model, here.data, qpos))
        here.data.qpos[:] = qpos[0]
        mujoco.mj_kinematics(self.model, here.data)
        return self.floor.depth(here.placed)

    def _ready(self, threads: int) -> int:
        """Return the number of threads; each has its own data."""
        self.places += [_Places(self.model, self.plain) for _ in range(len(self.places), threads)]
        return threads

    def _contacts(self, places: "_Places", qpos: Floats, placed: Placed) -> list[tuple[np.ndarray, ...]]:
        """Return MuJoCo's contacts at configurations (N, nq), one after the other; fill in where the robot is."""
        data, columns, contacts = places.data, vars(placed).values(), []
        for k, q in enumerate(qpos):
            data.qpos[:] = q
            mujoco.mj_kinematics(self.model, data)
            mujoco.mj_comPos(self.model, data)
            mujoco.mj_collision(self.model, data)
            if placed is not places.placed:
                for column, view in zip(columns, places.views, strict=True):
                    column[k] = view
            each = data.contact
            contacts.append((each.dist.copy(), each.geom.copy(), each.pos.copy(), each.frame[:, :3].copy()))
        return contacts

    def _contacts_along(self, qpos: Floats, threads: int) -> tuple[Placed, list[tuple[np.ndarray, ...]]]:
        """Return where the robot is in configurations (N, nq), and MuJoCo's contacts of each; one is read in place."""
        if len(qpos) == 1:
            placed = self.places[0].placed
            return placed, self._contacts(self.places[0], qpos, placed)
        placed = Placed.empty(self.model, len(qpos))
        found = in_parts(
            lambda k, rows: self._contacts(self.places[k], qpos[rows], placed.rows(rows)),
            len(qpos),
            self._ready(threads),
        )
        return placed, [each for part in found for each in part]

    def _measured(self, qpos: Floats, threads: int = 1) -> tuple[Placed, list[GeomDistances]]:
        """Place the robot in configurations (N, nq); return also where links are near each other, in parts."""
        placed, contacts = self._contacts_along(qpos, threads)
        frame = np.repeat(np.arange(len(qpos)), [len(each[0]) for each in contacts])
        found = GeomDistances(
            frame, *(contacts[0] if len(contacts) == 1 else map(np.concatenate, zip(*contacts, strict=True)))
        )
        seen = self.seen.take(found.geoms @ (self.model.ngeom, 1))
        found = found if seen.all() else found[np.flatnonzero(seen)]
        return placed, [found, self.boxes.near(placed)] if len(self.boxes.pairs) else [found]

    def _watch(self, pairs: Ints) -> None:
        """Leave to `Boxes` those of some pairs of geoms (N, 2) that count and are two boxes."""
        two_boxes = self.is_box[pairs].all(axis=1) & self.counts[pairs[:, 0], pairs[:, 1]]
        self.boxes = Boxes(self.model, pairs[two_boxes], self.reach)
        self.seen = self.counts & ~np.logical_and.outer(self.is_box, self.is_box)

    def _learn(self, found: GeomDistances, least: float = -np.inf) -> None:
        """Leave out pairs that overlap at rest; remember how near the others are, and the floor, `least` at least [m]."""
        for gap, (a, b) in zip(found.distance.clip(min=least), found.geoms, strict=True):
            self.counts[a, b] = self.counts[b, a] = self.counts[a, b] and gap > -TIE
            self.rest[a, b] = self.rest[b, a] = min(self.rest[a, b], gap)


class _Places:
    """MuJoCo's data of one thread."""

    def __init__(self, model: mujoco.MjModel, plain: mujoco.MjModel):
        """Make the data of the model with margins and of the plain one."""
        self.data, self.touching = mujoco.MjData(model), mujoco.MjData(plain)
        self.views: tuple[Floats, ...] = views(self.data)  # to ask for one takes as long as to use it
        self.placed: Placed = Placed.of(self.data)
        """Where the robot of `data` is."""


def _models(robot: Robot, reach: float) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Return the robot's model without margins, and the same with margins of half the reach [m]; both are read-only.

    A robot's models are kept: a copy takes as long as a hundred frames of a stream.
    """
    kept = _KEPT.setdefault(robot, {})
    if reach not in kept:
        plain = touchable(robot)
        kept[reach] = plain, _with_margins(plain, reach)
    return kept[reach]


def _with_margins(plain: mujoco.MjModel, reach: float) -> mujoco.MjModel:
    model = copy.deepcopy(plain)
    model.geom_margin[:] = reach / 2
    model.body_margin[:] = reach / 2  # the broad phase uses the margins of bodies
    model.pair_margin[:] = reach
    model.geom_gap[:] = model.pair_gap[:] = 0.0
    several = mujoco.mjtDisableBit.mjDSBL_MULTICCD  # pyright: ignore[reportAttributeAccessIssue]
    model.opt.disableflags |= several  # a distance has one place, the nearest
    still = ~_moves(model)
    model.geom_contype[still] = model.geom_conaffinity[still] = 0  # the floor of a scene costs time
    return model


def _moves(model: mujoco.MjModel) -> Bools:
    """Return which geoms move with a link (G,)."""
    return np.asarray(model.body_weldid)[model.geom_bodyid] != 0


class LinkDistances:
    """Distances of the P pairs of links that may touch, of one robot; the root does not matter."""

    robot: Robot
    reach: float

    def __init__(self, robot: Robot, reach: float = 0.02):
        """Measure distances up to `reach` [m]; farther links are reported at `reach`."""
        self.robot, self.reach, self._separation = robot, reach, Separation(robot, reach)
        model = robot.model
        self._link = np.asarray(model.body_weldid)[model.geom_bodyid]
        counts = self._separation.counts
        watched = [pair for pair, geoms in sorted(allowed(robot).items()) if any(counts[both] for both in geoms)]
        self.links: Ints = np.array(watched, dtype=np.int64).reshape(-1, 2)
        """(P, 2) body ids, the lower first."""
        self._column = np.full((model.nbody, model.nbody), -1)
        self._column[tuple(self.links.T)] = self._column[tuple(self.links[:, ::-1].T)] = np.arange(len(self.links))
        columns = [model.jnt_qposadr[j] for j in np.flatnonzero(model.jnt_type != FREE)]
        self._fixed = np.setdiff1d(np.arange(model.nq), columns)

    def __len__(self) -> int:
        return len(self.links)

    @cached_property
    def names(self) -> list[tuple[str, str]]:
        """Names of both links of every pair."""
        model = self.robot.model
        return [(model.body(a).name, model.body(b).name) for a, b in self.links.tolist()]

    def along(self, path: Floats) -> Floats:
        """Return the distances (T, P) of the pairs at configurations (T, nq), at most the reach, negative where links overlap [m]."""
        found = np.full((len(path), len(self.links)), self.reach)
        for first in range(0, len(path), POSED):
            poses = np.array(path[first : first + POSED])
            poses[:, self._fixed] = self.robot.model.qpos0[self._fixed]
            near = self._separation.distances(poses)
            columns = self._column[tuple(self._link[near.geoms.T])]
            watched = columns >= 0
            np.minimum.at(found, (first + near.frame[watched], columns[watched]), near.distance[watched])
        return found
