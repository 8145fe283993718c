"""Joints that are geared together and chains that close: the equality constraints of an MJCF, and its tendons with hardly any play.

A gear of three joints, as in a waist on a differential, has no equality constraint in MuJoCo: models write
it as a tendon of joints whose length may hardly change.
"""

import copy

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.robot.links import RANK
from robot_retarget.robot.model import Robot

_BIT = mujoco.mjtDisableBit
_OTHERS = sum(int(bit) for bit in (_BIT.mjDSBL_CONTACT, _BIT.mjDSBL_LIMIT, _BIT.mjDSBL_FRICTIONLOSS))

STRIDE = 0.2
"""Longest step of a joint towards a closed chain [rad or m]: half and double do not change a walk of ToddlerBot."""
CARRIER = 0.01
"""Share by which a joint that carries others moves to close a chain, against one at the end of its branch [-]: half and
double do not change a walk of ToddlerBot."""
PLAY = 0.1
"""A tendon of joints whose length may change by less is a gear, held in the middle of its play [rad]: half lowers the
cost of a walk of ToddlerBot by 0.2 %, double leaves it."""


class Coupling:
    """The violations of a robot's equality constraints and their slopes, as MuJoCo computes them."""

    turns: Floats
    middle: Floats
    data: mujoco.MjData
    mobility: Floats

    def __init__(self, robot: Robot):
        self.turns, self.middle = _gears(robot.model)
        self.present: bool = bool(robot.model.neq and robot.model.eq_active0.any()) or bool(len(self.turns))
        if not self.present:
            return
        self.model: mujoco.MjModel = copy.deepcopy(robot.model)
        self.model.opt.disableflags |= _OTHERS
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data, self.mobility = mujoco.MjData(self.model), _mobility(robot)
        self._hinges = self.model.jnt_qposadr[self.model.dof_jntid]

    def __call__(self, qpos: Floats) -> tuple[Floats, Floats]:
        """Violations (E,) [m or rad] and slopes by the tangent v (E, nv), of a robot in which they are `present`."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        rows = self.data.ne
        slope = np.asarray(self.data.efc_J).reshape(-1, self.model.nv)[:rows]
        mesh = self.turns @ qpos[self._hinges] - self.middle
        return np.concatenate([self.data.efc_pos[:rows], mesh]), np.concatenate([slope, self.turns])

    def close_chains(self, qpos: Floats, steps: int = 8) -> Floats:
        """Return a nearby configuration that satisfies all constraints, by Newton steps that move mostly joints without children.

        Steps are short, so that a rod near its dead centre is not thrown onto another branch.

        Args:
            qpos: (nq,) configuration.
            steps: largest number of Newton steps.
        """
        q = np.array(qpos)
        for _ in range(steps if self.present else 0):
            violation, slope = self(q)
            if np.abs(violation).max(initial=0.0) < 1e-9:
                break
            eased = slope * self.mobility
            step = -self.mobility * (np.linalg.pinv(eased, rcond=RANK) @ violation)
            step *= min(1.0, STRIDE / max(float(np.abs(step).max()), STRIDE))
            mujoco.mj_integratePos(self.model, q, step, 1.0)
        return q


def _gears(model: mujoco.MjModel) -> tuple[Floats, Floats]:
    """Tendons of joints with hardly any play: by how much each dof moves them (G, nv), and the middle of their play (G,)."""
    width = np.diff(model.tendon_range, axis=1).ravel()
    tight = np.flatnonzero(np.asarray(model.tendon_limited, bool) & (width < PLAY))
    turns = np.zeros((len(tight), model.nv))
    gears = []
    for row, tendon in zip(turns, tight, strict=True):
        own = slice(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon]))
        if (model.wrap_type[own] == mujoco.mjtWrap.mjWRAP_JOINT).all():
            np.add.at(row, model.jnt_dofadr[model.wrap_objid[own]], model.wrap_prm[own])
            gears.append(tendon)
    return turns[turns.any(axis=1)], model.tendon_range[gears].mean(axis=1)


def _mobility(robot: Robot) -> Floats:
    """(nv,) 1 for joints at the end of their branch (gears, rods), `CARRIER` for the others, 0 for the root."""
    model = robot.model
    mobility = np.full(model.nv, CARRIER)
    for joint in robot.joint_ids:
        if not (model.body_parentid == model.jnt_bodyid[joint]).any():
            mobility[model.jnt_dofadr[joint]] = 1.0
    mobility[np.isin(model.dof_jntid, robot.root_joints)] = 0.0
    return mobility
