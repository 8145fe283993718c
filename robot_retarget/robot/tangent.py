"""Configurations as points that can be moved and compared: MuJoCo's velocity space, over one second."""

import mujoco
import numpy as np

from robot_retarget.arrays import Floats


def plus(model: mujoco.MjModel, qpos: Floats, step: Floats) -> Floats:
    """A configuration (nq,) moved by a step (nv,): q ⊕ v."""
    moved = np.array(qpos, dtype=float)
    mujoco.mj_integratePos(model, moved, np.asarray(step, dtype=float), 1.0)
    return moved


def minus(model: mujoco.MjModel, qpos: Floats, other: Floats) -> Floats:
    """The step (nv,) from another configuration to this one: q ⊖ o."""
    step = np.empty(model.nv)
    mujoco.mj_differentiatePos(model, step, 1.0, np.asarray(other, dtype=float), np.asarray(qpos, dtype=float))
    return step
