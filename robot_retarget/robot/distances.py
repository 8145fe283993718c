"""Signed distances between the links of a robot, by the distance engine of the solver."""

from functools import cached_property

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.geoms import allowed
from robot_retarget.robot.kinematics import BLOCK
from robot_retarget.robot.model import FREE, Robot
from robot_retarget.robot.separation import Separation


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

    def at(self, qpos: Floats) -> Floats:
        """Return the distances of the pairs, at most the reach and negative where links overlap.

        Args:
            qpos: (nq,) configuration; the pose of the root does not matter.

        Returns:
            (P,) distances in the order of `links` [m].
        """
        return self.along(np.array(qpos, dtype=float)[None])[0]

    def along(self, path: Floats) -> Floats:
        """Return the distances (T, P) at configurations (T, nq) [m]."""
        found = np.full((len(path), len(self.links)), self.reach)
        for first in range(0, len(path), BLOCK):
            poses = np.array(path[first : first + BLOCK])
            poses[:, self._fixed] = self.robot.model.qpos0[self._fixed]
            near = self._separation.distances(poses)
            columns = self._column[tuple(self._link[near.geoms.T])]
            watched = columns >= 0
            np.minimum.at(found, (first + near.frame[watched], columns[watched]), near.distance[watched])
        return found
