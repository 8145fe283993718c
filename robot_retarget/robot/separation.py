"""Distances between near links, and their Jacobians.

MuJoCo finds the pairs by the model's own contact filter, with margins widened to the reach (it adds the margins of two
geoms), and gives the Jacobians as rows of its constraints. Pairs of boxes and the floor have their own modules. Pairs that
overlap where the robot rests are left out: they overlap by construction.
"""

import copy

import mujoco
import numpy as np

from robot_retarget.arrays import Bools, Floats, Ints
from robot_retarget.robot.boxes import Boxes, GeomDistances
from robot_retarget.robot.floor import Floor
from robot_retarget.robot.geoms import allowed, touchable
from robot_retarget.robot.kinematics import carrying
from robot_retarget.robot.model import Robot

STILL = 0.4
"""Share of the reach within which the floor is watched [-]: it does not move."""
TIE = 1e-6
"""Links that overlap deeper at rest are left out [m]: far above the engine's rounding."""
_YZX = [1, 2, 0]


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
        self.plain: mujoco.MjModel = touchable(robot)
        self.model, self.reach = copy.deepcopy(self.plain), reach
        self.model.geom_margin[:] = reach / 2
        self.model.body_margin[:] = reach / 2  # the broad phase uses the margins of bodies
        self.model.pair_margin[:] = reach
        _one_row_a_contact(self.model)
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        self.touching: mujoco.MjData = mujoco.MjData(self.plain)
        self.bodies: Ints = np.append(np.asarray(self.model.geom_bodyid), 0)
        """(G + 1,) that geoms belong to; the floor, which comes last, to the world."""
        self.trees: Ints = np.asarray(self.model.body_rootid)[self.bodies]
        carried = carrying(self.model).astype(float)
        self.between: Floats = (carried[None] - carried[:, None]).reshape(-1, self.model.nv)
        """(B², nv) +1 where a dof carries the second of two bodies alone, −1 where it carries the first."""
        # Views are kept: to ask for one takes as long as to use it.
        self._centres, self._dofs = self.data.subtree_com, self.data.cdof
        solid = np.asarray(self.model.body_weldid)[self.model.geom_bodyid] != 0
        self.model.geom_contype[~solid] = self.model.geom_conaffinity[~solid] = 0  # the floor of a scene costs time
        self.counts: Bools = np.logical_and.outer(solid, solid)
        self.rest: Floats = np.full((self.model.ngeom + 1,) * 2, np.inf)
        """(G + 1, G + 1) distance of two geoms at rest [m]; the floor, which comes last, may be touched."""
        self.rest[-1] = self.rest[:, -1] = 0.0
        self.is_box: Bools = np.asarray(self.model.geom_type) == mujoco.mjtGeom.mjGEOM_BOX
        listed = allowed(robot).values() if self.is_box.sum() > 1 else ()
        self._watch(np.array([pair for pairs in listed for pair in pairs], dtype=int).reshape(-1, 2))
        for rest in (robot.neutral(), np.array(robot.model.qpos0)):
            self._learn(rest)
        self._watch(self.boxes.pairs)
        self.floor: Floor | None = None if feet is None else Floor(robot, self.model, self.data, feet, STILL * reach)

    def near(self, qpos: Floats) -> tuple[Floats, Ints, Floats]:
        """Return distances (C,) [m], negative inside, geoms (C, 2) and slopes by v (C, nv), the floor included."""
        distance, geoms, slope = self.found(qpos)
        if self.floor is None or (low := self.floor.near()) is None:
            return distance, geoms, slope
        distance, geoms = np.append(distance, low.distance), np.concatenate([geoms, low.geoms])
        return distance, geoms, np.concatenate([slope, self._slopes(low)])

    def _slopes(self, found: GeomDistances) -> Floats:
        """Return (C, nv) slopes by v of distances without MuJoCo contacts.

        Along the normal n, a point moves by n·(travel + turn × arm) with every dof that carries its body.
        """
        first, second = found.geoms.T
        arm, along = found.place - self._centres.take(self.trees.take(second), axis=0), found.normal
        moment = (arm * along.take(_YZX, 1) - arm.take(_YZX, 1) * along).take(_YZX, 1)
        slope = np.concatenate([moment, along], axis=1) @ self._dofs.T
        slope *= self.between.take(self.bodies.take(first) * self.model.nbody + self.bodies.take(second), axis=0)
        return slope

    def depth(self, qpos: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m], 0 when none overlap."""
        return float(self.overlaps(qpos)[0].max(initial=0.0))

    def overlaps(self, qpos: Floats) -> tuple[Floats, Ints]:
        """Return depths (C,) [m] and geoms (C, 2) of overlapping links, by MuJoCo's contacts.

        This model has no margins: contacts take a third of the time, and a twentieth for robots of many boxes.
        """
        self.touching.qpos[:] = qpos
        mujoco.mj_kinematics(self.plain, self.touching)
        mujoco.mj_collision(self.plain, self.touching)
        found = self.touching.contact
        if found.dist.min(initial=0.0) >= 0:
            return np.zeros(0), np.zeros((0, 2), dtype=np.int64)
        first, second = found.geom.T
        counted = np.flatnonzero(self.counts[first, second] & (found.dist < 0))
        return -found.dist[counted], found.geom[counted]

    def floor_penetration(self, qpos: Floats) -> float:
        """Return the depth of links other than feet under the floor [m], 0 if all are above it."""
        if self.floor is None:
            return 0.0
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        return self.floor.depth()

    def found(self, qpos: Floats) -> tuple[Floats, Ints, Floats]:
        """Return all places where links are near each other.

        Args:
            qpos: (nq,).

        Returns:
            Distances (C,) [m], geoms (C, 2), and slopes of the distances by v (C, nv).
        """
        seen, boxes = self._collide(qpos)
        data = self.data
        mujoco.mj_makeConstraint(self.model, data)
        slope = data.efc_J.reshape(-1, self.model.nv).take(data.contact.efc_address.take(seen), axis=0)
        distance, geoms = data.contact.dist.take(seen), data.contact.geom.take(seen, axis=0)
        if boxes is None:
            return distance, geoms, slope
        distance, geoms = np.append(distance, boxes.distance), np.concatenate([geoms, boxes.geoms])
        return distance, geoms, np.concatenate([slope, self._slopes(boxes)])

    def distances(self, qpos: Floats) -> tuple[Floats, Ints]:
        """Return distances (C,) [m] and geoms (C, 2) of all places where links are near each other at qpos (nq,)."""
        seen, boxes = self._collide(qpos)
        distance, geoms = self.data.contact.dist.take(seen), self.data.contact.geom.take(seen, axis=0)
        if boxes is None:
            return distance, geoms
        return np.append(distance, boxes.distance), np.concatenate([geoms, boxes.geoms])

    def _collide(self, qpos: Floats) -> tuple[Ints, GeomDistances | None]:
        """Return the contacts (S,) of MuJoCo that count, and the places of boxes, or None for a robot without boxes."""
        data = self.data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_collision(self.model, data)
        pairs = data.contact.geom
        seen = self.seen[pairs[:, 0], pairs[:, 1]].nonzero()[0]
        return seen, self.boxes.near(data) if len(self.boxes.pairs) else None

    def _watch(self, pairs: Ints) -> None:
        """Leave to `Boxes` those of some pairs of geoms (N, 2) that count and are two boxes."""
        two_boxes = self.is_box[pairs].all(axis=1) & self.counts[pairs[:, 0], pairs[:, 1]]
        self.boxes = Boxes(self.model, pairs[two_boxes], self.reach)
        self.seen = self.counts & ~np.logical_and.outer(self.is_box, self.is_box)

    def _learn(self, rest: Floats) -> None:
        """Leave out pairs that overlap at rest; remember how near the others are."""
        for gap, (a, b) in zip(*self.found(rest)[:2], strict=True):
            self.counts[a, b] = self.counts[b, a] = self.counts[a, b] and gap > -TIE
            self.rest[a, b] = self.rest[b, a] = min(self.rest[a, b], gap)


def _one_row_a_contact(model: mujoco.MjModel) -> None:
    """Give each contact one row in the Jacobian of the constraints, along its normal, and disable all other rows."""
    model.geom_condim[:] = model.pair_dim[:] = 1
    model.geom_gap[:] = model.pair_gap[:] = 0.0
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_EQUALITY | off.mjDSBL_FRICTIONLOSS | off.mjDSBL_LIMIT
