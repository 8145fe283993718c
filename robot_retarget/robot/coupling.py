"""Joints that are geared together and chains that close: the equality constraints of an MJCF."""

import copy

import mujoco
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.model import Robot

_BIT = mujoco.mjtDisableBit
_OTHERS = sum(int(bit) for bit in (_BIT.mjDSBL_CONTACT, _BIT.mjDSBL_LIMIT, _BIT.mjDSBL_FRICTIONLOSS))

STRIDE = 0.2
"""Longest step of a joint towards a closed chain [rad or m]."""


class Coupling:
    """The violations of a robot's equality constraints and their slopes, as MuJoCo computes them."""

    def __init__(self, robot: Robot):
        self.model = copy.deepcopy(robot.model)
        self.model.opt.disableflags |= _OTHERS
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)
        self.present = bool(self.model.neq and self.data.eq_active.any())
        self.mobility = _mobility(robot)

    def __call__(self, qpos: Floats) -> tuple[Floats, Floats]:
        """Violations (E,) [m or rad] and slopes by the tangent v (E, nv)."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_makeConstraint(self.model, self.data)
        rows = self.data.ne
        slope = np.asarray(self.data.efc_J).reshape(-1, self.model.nv)[:rows]
        return self.data.efc_pos[:rows].copy(), slope.copy()

    def closed(self, qpos: Floats, steps: int = 8) -> Floats:
        """The configuration nearby that holds every constraint: Newton steps that move what nothing hangs on.

        Steps are short, so that a rod near its dead centre is not thrown onto another branch.
        """
        q = np.array(qpos)
        for _ in range(steps if self.present else 0):
            violation, slope = self(q)
            if np.abs(violation).max(initial=0.0) < 1e-9:
                break
            eased = slope * self.mobility
            step = -self.mobility * (np.linalg.pinv(eased, rcond=1e-10) @ violation)
            step *= min(1.0, STRIDE / max(float(np.abs(step).max()), STRIDE))
            mujoco.mj_integratePos(self.model, q, step, 1.0)
        return q


def _mobility(robot: Robot) -> Floats:
    """(nv,) 1 for joints at the end of their branch (gears, rods), little for the others, least for the root."""
    model = robot.model
    mobility = np.full(model.nv, 1e-2)
    for joint in robot.joint_ids:
        if not (model.body_parentid == model.jnt_bodyid[joint]).any():
            mobility[model.jnt_dofadr[joint]] = 1.0
    for joint in robot.root_joints:
        first = model.jnt_dofadr[joint]
        mobility[first : first + (6 if robot.floating else 1)] = 1e-4
    return mobility
