"""How far apart the surfaces of links are, and where points of links are, by MuJoCo.

Asked one by one, distances cost more in the asking than in the answer. So a model carries distance sensors that are
pointed at the geoms in question as they come up, and one call reads them all. Links of several geoms have a convex hull
around them besides, which is no farther away than they are. Points are sites of another model.
"""

import itertools
from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot.capsules import collision_geoms, link_clouds
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot

SENSORS = 512
"""So many pairs of geoms are measured in one call."""
PATIENCE = 8
"""So many calls after their hulls were near, links of several geoms are still asked for geom by geom at once."""
_AWAKE, _ASLEEP = mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_NONE
_SITE, _HULL = "measured {}", "hull of {}"
_KEPT = 4
"""So many compiled models are kept: to copy one takes a tenth of the time."""


@dataclass(frozen=True)
class Pairs:
    """P pairs of links and, for each, the pairs of geoms that may touch."""

    links: Ints
    """(P, 2) body ids, the lower first."""
    geoms: tuple[tuple[tuple[int, int], ...], ...]
    """P lists of geom pairs."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", frozen(np.reshape(self.links, (-1, 2)), np.int64))

    def __len__(self) -> int:
        return len(self.links)

    def names(self, robot: Robot) -> list[tuple[str, str]]:
        """The links' names."""
        return [(robot.model.body(a).name, robot.model.body(b).name) for a, b in self.links.tolist()]


class Marks:
    """Where points fixed to links are."""

    def __init__(self, robot: Robot, points: Points):
        """Point the sites of a model of its own at the points."""
        self._model = model = deepcopy(_marked(robot, len(points)))
        self._data = mujoco.MjData(model)
        first = model.site(_SITE.format(0)).id if len(points) else 0
        added = slice(first, first + len(points))
        model.site_bodyid[added], model.site_pos[added] = points.bodies, points.offsets
        model.site_sameframe[added] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        self._qpos, self._places = self._data.qpos, self._data.site_xpos[added]

    def along(self, path: Floats) -> Floats:
        """Places (K, N, 3) at configurations (K, nq) [m]."""
        places = np.empty((len(path), *self._places.shape))
        for k, qpos in enumerate(path):
            self._qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
            places[k] = self._places
        return places


class Clearance:
    """Distances between the geoms of pairs of links."""

    def __init__(self, robot: Robot, pairs: Pairs):
        """Take a model of its own, with as many sensors as are needed at once."""
        sensing = _sensing(robot)
        self.pairs, self._model = pairs, deepcopy(sensing.model)
        self._geoms = [sensing.places[np.reshape(geoms, (-1, 2)).astype(int)] for geoms in pairs.geoms]
        self._shapes = np.array([geoms[0] for geoms in self._geoms], dtype=np.int64).reshape(-1, 2)
        self._several = [len(geoms) > 1 for geoms in self._geoms]
        for k in np.flatnonzero(self._several):
            self._shapes[k] = [sensing.hulls[link] for link in pairs.links[k].tolist()]
        self._patience = [0] * len(self._geoms)
        model, self._data = self._model, mujoco.MjData(self._model)
        # Views are kept: to ask the model for one takes longer than to write it.
        self._first, self._second, self._cutoff = model.sensor_objid, model.sensor_refid, model.sensor_cutoff
        self._stage, self._awake = model.sensor_needstage, 0
        self._qpos, self._read = self._data.qpos, self._data.sensordata

    def along(self, path: Floats, pairs: Ints, reach: float) -> Floats:
        """Distances (K, N) of pairs (N,) at configurations (K, nq) [m], negative inside; `reach` for all that is farther.

        Links of several geoms are asked for as their hulls, and geom by geom where those are near, or were of late.
        """
        shapes, patience = self._shapes[pairs], self._patience
        several = [(n, pair) for n, pair in enumerate(pairs.tolist()) if self._several[pair]]
        fine = {n: self._geoms[pair] for n, pair in several if patience[pair]}
        if fine:  # in place of hulls, which take long where they overlap
            shapes[list(fine)] = [table[0] for table in fine.values()]
        every = self._sensed(path, [shapes, *(table[1:] for table in fine.values())], reach)
        found = every[:, : len(pairs)]
        if fine:
            rest = _least(every[:, len(pairs) :], [len(table) - 1 for table in fine.values()])
            found[:, list(fine)] = np.minimum(found[:, list(fine)], rest)
        if several:
            self._look_closer(path, several, found, reach)
        return found

    def _look_closer(self, path: Floats, several: list[tuple[int, int]], found: Floats, reach: float) -> None:
        """Where hulls are near, have their geoms in place of them in found (K, N), and the next calls ask for those."""
        near: list[bool] = np.any(found[:, [n for n, _ in several]] < reach, axis=0).tolist()
        late = {
            n: self._geoms[pair]
            for (n, pair), close in zip(several, near, strict=True)
            if close and not self._patience[pair]
        }
        if late:
            every = self._sensed(path, list(late.values()), reach)
            found[:, list(late)] = _least(every, [len(table) for table in late.values()])
        for (_, pair), close in zip(several, near, strict=True):
            self._patience[pair] = PATIENCE if close else max(self._patience[pair] - 1, 0)

    def all(self, path: Floats, reach: float) -> Floats:
        """Distances (K, P) of all pairs, `reach` for all that is farther [m]."""
        return self.along(path, np.arange(len(self.pairs)), reach)

    def _sensed(self, path: Floats, tables: list[Ints], reach: float) -> Floats:
        """Distances (K, G) of all pairs of geoms in some tables."""
        geoms = np.concatenate(tables) if len(tables) > 1 else tables[0]
        model, data, found = self._model, self._data, np.empty((len(path), len(geoms)))
        for first in range(0, len(geoms), SENSORS):
            part = slice(first, first + SENSORS)
            self._point_sensors(geoms[part], reach)
            for qpos, row in zip(path, found[:, part], strict=True):
                self._qpos[:] = qpos
                mujoco.mj_kinematics(model, data)
                mujoco.mj_sensorPos(model, data)
                row[:] = self._read[: len(row)]
        return found

    def _point_sensors(self, geoms: Ints, reach: float) -> None:
        """Point the first sensors at geoms (G, 2); the others sleep."""
        awake, before = len(geoms), self._awake
        self._first[:awake], self._second[:awake] = geoms.T
        self._cutoff[:awake] = reach
        self._stage[before:awake], self._stage[awake:before] = _AWAKE, _ASLEEP
        self._awake = awake


def _least(distances: Floats, counts: list[int]) -> Floats:
    """(K, N) of N lists of geom pairs that have so many each, from distances (K, G) of all of them."""
    return np.minimum.reduceat(distances, [0, *itertools.accumulate(counts[:-1])], axis=1)


@lru_cache(maxsize=_KEPT)
def _marked(robot: Robot, count: int) -> mujoco.MjModel:
    """The model with so many sites, of the world at first: there they are numbered as they come."""
    spec = robot.spec()
    for k in range(count):
        spec.worldbody.add_site(name=_SITE.format(k))
    return spec.compile()


@dataclass(frozen=True, eq=False)
class _Sensing:
    """A robot's model with distance sensors, asleep, in place of its own."""

    model: mujoco.MjModel
    places: Ints
    """Its geoms that are those of the robot's own model, in that order."""
    hulls: dict[int, int]
    """By link that takes part in contacts, its hull; its geom where it has no other."""


@lru_cache(maxsize=_KEPT)
def _sensing(robot: Robot) -> _Sensing:
    spec = robot.spec()
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    geoms = list(spec.geoms)
    solid = {link: geoms[own[0]] for link, own in collision_geoms(robot).items()}
    for k, geom in enumerate(geoms[:2]):  # a sensor is made between names, and pointed elsewhere later
        geom.name = geom.name or f"sensed {k}"
    for link, clouds in link_clouds(robot).items():
        if len(clouds) > 1:
            solid[link] = _hull(spec, link, np.concatenate([cloud.corners for cloud in clouds]))
    kind, what = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtSensor.mjSENS_GEOMDIST
    for _ in range(SENSORS):
        first, second = (geom.name for geom in geoms[:2])
        spec.add_sensor(type=what, objtype=kind, objname=first, reftype=kind, refname=second)
    model = spec.compile()
    model.sensor_datatype[:] = mujoco.mjtDataType.mjDATATYPE_POSITIVE  # cut off above only, not overlaps
    model.sensor_needstage[:] = _ASLEEP
    places = np.array([geom.id for geom in geoms], dtype=np.int64)
    return _Sensing(model, places, {link: geom.id for link, geom in solid.items()})


def _hull(spec: mujoco.MjSpec, link: int, points: Floats) -> mujoco.MjsGeom:
    """Give a link one more geom, the convex hull of points in its frame."""
    name = _HULL.format(link)
    spec.add_mesh(name=name, uservert=points.ravel(), scale=[1, 1, 1])
    return spec.bodies[link].add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0)
