"""Root and legs that follow soles and centre of mass, frame by frame, under the limbs of given configurations.

    minimise  ‖soles − places‖² + ‖c − c*‖² + Σ w_i² (v_i − v*_i)²        c the centre of mass, v root and legs

by Gauss–Newton over six degrees of freedom of the root and those of the legs: with legs of six hinges, soles and centre of mass leave height and
orientation of the root, which stay near the given ones. A frame takes 0.4 ms, a tenth of solving all edges; the zero moment point of a walk then is
within 1 mm of that of the solved limbs, in the median.
"""

import mujoco
import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.robot.dynamics import root_dofs, root_travel
from robot_retarget.robot.kinematics import Points, difference, integrate
from robot_retarget.robot.model import Robot

LEVEL, UPRIGHT, EASY = 0.003, 0.03, 0.001
"""w of the root along the floor, of its height and turns, and of hinges, all below 1, the w of soles and mass: they yield by less than 1 mm [-]."""
STEPS, ARRIVED = 8, 1e-3
"""Largest number of Gauss–Newton steps, of which walks of the OP3 take 3 to 6, and the last step that ends them [m, rad]: places then err by its square, 1e-6."""


def legs_following(robot: Robot, qpos: Floats, legs: Bools, soles: Points, places: Floats, centres: Floats) -> Floats:
    """Return configurations (T, nq) with soles at places and the centre of mass over a path.

    Args:
        qpos: (T, nq) gives arms, trunk and head, and where root and legs are about.
        legs: (nv,) the dofs of the legs.
        soles: points of the soles.
        places: (T, P, 3) of these [m].
        centres: (T, 2) path of the centre of mass, seen from above [m].
    """
    model, body, data = robot.model, robot.root_body, mujoco.MjData(robot.model)
    dofs = np.concatenate([root_dofs(robot), np.flatnonzero(legs)])
    width, count = len(dofs), 3 * len(soles) + 2
    weights = np.full(model.nv, EASY)
    weights[root_dofs(robot)], weights[root_travel(robot)[:2]] = UPRIGHT, LEVEL
    rows, missing, slope = np.zeros((count + width, width)), np.zeros(count + width), np.zeros((3, model.nv))
    rows[count:] = np.diag(weights[dofs])
    lower, upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
    lower[robot.qpos_index], upper[robot.qpos_index] = robot.lower, robot.upper
    step, found = np.zeros(model.nv), np.array(qpos)
    for k, own in enumerate(qpos):
        for _ in range(STEPS):
            data.qpos[:] = found[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            turned = np.einsum("pij,pj->pi", data.xmat[soles.bodies].reshape(-1, 3, 3), soles.offsets)
            here = data.xpos[soles.bodies] + turned
            for p, point in enumerate(here):
                mujoco.mj_jac(model, data, slope, None, point, int(soles.bodies[p]))
                rows[3 * p : 3 * p + 3] = slope[:, dofs]
            mujoco.mj_jacSubtreeCom(model, data, slope, body)
            rows[count - 2 : count] = slope[:2, dofs]
            missing[: count - 2] = (places[k] - here).ravel()
            missing[count - 2 : count] = centres[k] - data.subtree_com[body, :2]
            missing[count:] = (weights * difference(robot, found[k], own))[dofs]
            step[dofs] = np.linalg.solve(rows.T @ rows, rows.T @ missing)
            found[k] = np.clip(integrate(robot, found[k], step), lower, upper)
            if np.abs(step).max() < ARRIVED:
                break
    return found
