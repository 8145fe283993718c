"""How far apart the surfaces of links are, and where points of links are, by MuJoCo.

Asked one by one, distances cost more in the asking than in the answer. So a model carries distance sensors that are
pointed at the geoms in question as they come up, and one call reads them all. Points are sites of another model.
"""

from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot

SENSORS = 512
"""So many pairs of geoms are measured in one call."""
_AWAKE, _ASLEEP = mujoco.mjtStage.mjSTAGE_POS, mujoco.mjtStage.mjSTAGE_NONE
_SITE = "measured {}"
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

    def of(self, keep: np.ndarray) -> "Pairs":
        """Those that a mask (P,) chooses."""
        return Pairs(self.links[keep], tuple(self.geoms[k] for k in np.flatnonzero(keep)))

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
        self.pairs, self._geoms = pairs, [np.array(geoms, dtype=np.int32).reshape(-1, 2) for geoms in pairs.geoms]
        self._counts = np.array([len(geoms) for geoms in self._geoms], dtype=np.int64)
        self._model = model = deepcopy(_sensing(robot, min(SENSORS, int(self._counts.sum()))))
        self._data = data = mujoco.MjData(model)
        # Views are kept: to ask the model for one takes longer than to write it.
        self._first, self._second, self._reach = model.sensor_objid, model.sensor_refid, model.sensor_cutoff
        self._stage, self._qpos, self._read, self._awake = model.sensor_needstage, data.qpos, data.sensordata, 0

    def along(self, path: Floats, pairs: Ints, reach: Floats) -> Floats:
        """Distances (K, N) of pairs (N,) at configurations (K, nq) [m], negative inside.

        Args:
            reach: (N,) all that is farther counts as this far [m].
        """
        if not len(pairs):
            return np.zeros((len(path), 0))
        tables = [self._geoms[pair] for pair in pairs.tolist()]
        geoms, counts = np.concatenate(tables), self._counts[pairs]
        limits, found = np.repeat(reach, counts), np.empty((len(path), len(geoms)))
        model, data = self._model, self._data
        for first in range(0, len(geoms), SENSORS):
            part = slice(first, first + SENSORS)
            self._point_sensors(geoms[part], limits[part])
            for qpos, row in zip(path, found[:, part], strict=True):
                self._qpos[:] = qpos
                mujoco.mj_kinematics(model, data)
                mujoco.mj_sensorPos(model, data)
                row[:] = self._read[: len(row)]
        return found if len(geoms) == len(pairs) else np.minimum.reduceat(found, np.cumsum(counts) - counts, axis=1)

    def all(self, path: Floats, reach: float) -> Floats:
        """Distances (K, P) of all pairs, `reach` for all that is farther [m]."""
        return self.along(path, np.arange(len(self.pairs)), np.full(len(self.pairs), reach))

    def _point_sensors(self, geoms: Ints, reach: Floats) -> None:
        """Point the first sensors at geoms (G, 2); the others sleep."""
        awake, before = len(geoms), self._awake
        self._first[:awake], self._second[:awake] = geoms.T
        self._reach[:awake] = reach
        self._stage[before:awake], self._stage[awake:before] = _AWAKE, _ASLEEP
        self._awake = awake


@lru_cache(maxsize=_KEPT)
def _marked(robot: Robot, count: int) -> mujoco.MjModel:
    """The model with so many sites, of the world at first: there they are numbered as they come."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    for k in range(count):
        spec.worldbody.add_site(name=_SITE.format(k))
    return spec.compile()


@lru_cache(maxsize=_KEPT)
def _sensing(robot: Robot, count: int) -> mujoco.MjModel:
    """The model with so many distance sensors, asleep, in place of its own."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    for k, geom in enumerate(spec.geoms[:2]):  # a sensor is made between names, and pointed elsewhere later
        geom.name = geom.name or f"sensed {k}"
    kind, what = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtSensor.mjSENS_GEOMDIST
    for _ in range(count):
        first, second = (geom.name for geom in spec.geoms[:2])
        spec.add_sensor(type=what, objtype=kind, objname=first, reftype=kind, refname=second)
    model = spec.compile()
    model.sensor_datatype[:] = mujoco.mjtDataType.mjDATATYPE_POSITIVE  # cut off above only, not overlaps
    model.sensor_needstage[:] = _ASLEEP
    return model
