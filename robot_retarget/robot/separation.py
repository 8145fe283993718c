"""Surfaces of links that come near each other: their distances and how a step changes them.

MuJoCo finds the pairs, by the model's own contact filter, with every margin widened to the reach. Pairs that overlap
where the robot rests are left out: they do so by construction.
"""

import copy

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.model import Robot

OVERLAP = 1e-6
"""Links that rest deeper in each other are left out [m]; one touch must not be told from another by rounding."""
_YZX, _ZXY = [1, 2, 0], [2, 0, 1]


class Separation:
    """Distances of near surfaces of one robot, and their Jacobians by the tangent v."""

    def __init__(self, robot: Robot, reach: float, most: int = 24):
        """Look `reach` [m] around every geom and keep at most so many nearest contacts."""
        self.model = copy.deepcopy(robot.model)
        self.model.geom_margin[:] = reach
        self.model.pair_margin[:] = reach
        self.data = mujoco.MjData(self.model)
        self.most = most
        self.carried = carrying(self.model).astype(float)
        solid = np.asarray(self.model.body_weldid)[self.model.geom_bodyid] != 0
        self.counts = np.logical_and.outer(solid, solid)
        self.rest = np.full(self.counts.shape, np.inf)
        for rest in (robot.neutral(), np.array(robot.model.qpos0)):
            self._learn(rest)

    def near(self, qpos: Floats) -> tuple[Floats, Floats, Floats]:
        """Distances (C,) [m], negative inside, their slopes by v (C, nv), and how far apart each pair rests (C,) [m]."""
        distance, pair, place, normal = self._contacts(qpos)
        order = np.argsort(distance)[: self.most]
        first, second = self.model.geom_bodyid[pair[order]].T
        arm, along = place[order] - self.data.subtree_com[self.model.body_rootid[first]], normal[order]
        # Along the normal n, a point moves by n·(travel + turn × arm) with every dof that carries its body.
        moment = arm[:, _YZX] * along[:, _ZXY] - arm[:, _ZXY] * along[:, _YZX]
        slope = np.concatenate([moment, along], axis=1) @ self.data.cdof.T
        slope *= self.carried[second] - self.carried[first]
        return distance[order], slope, self.rest[pair[order, 0], pair[order, 1]]

    def depth(self, qpos: Floats) -> float:
        """How deep the deepest two links are inside each other [m], 0 when none touch."""
        return float(-self._contacts(qpos)[0].min(initial=0.0))

    def _contacts(self, qpos: Floats) -> tuple[Floats, np.ndarray, Floats, Floats]:
        """Distance (C,), geoms (C, 2), place (C, 3) and normal from the first to the second (C, 3) of what counts."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        found = self.data.contact
        pair = np.asarray(found.geom)
        keep = np.flatnonzero(self.counts[pair[:, 0], pair[:, 1]])
        return found.dist[keep], pair[keep], found.pos[keep], found.frame[keep, :3]

    def _learn(self, rest: Floats) -> None:
        """Leave out pairs that overlap at rest; remember how near the others are."""
        distance, pair, *_ = self._contacts(rest)
        for gap, (a, b) in zip(distance, pair, strict=True):
            self.counts[a, b] = self.counts[b, a] = self.counts[a, b] and gap > -OVERLAP
            self.rest[a, b] = self.rest[b, a] = min(self.rest[a, b], gap)


def carrying(model: mujoco.MjModel) -> np.ndarray:
    """(B, nv) whether a dof moves a body."""
    table = np.zeros((model.nbody, model.nv), dtype=bool)
    for body in range(1, model.nbody):
        table[body] = table[model.body_parentid[body]]
        first = model.body_dofadr[body]
        table[body, first : first + model.body_dofnum[body]] = True
    return table
