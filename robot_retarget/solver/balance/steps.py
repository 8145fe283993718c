"""The steps alone: root and legs follow a plan, frame by frame, under the limbs of its targets.

    minimise  ‖soles − places‖² + ‖c − c*‖² + Σ w_i² (v_i − v*_i)²        c the centre of mass, v root and legs

by Gauss–Newton over six degrees of freedom of the root and those of the legs: with legs of six hinges, soles and centre of mass leave height and
orientation of the root, which stay near the targets. It takes 0.4 ms a frame, a tenth of solving all edges, and gives the zero moment point of a
playback to 1 mm in the median.
"""

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.robot.dynamics import root_dofs, root_travel
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.solver.balance.balanced_ik import BalancedIk
from robot_retarget.solver.balance.plan import PlaybackPlan
from robot_retarget.solver.smooth import within_speeds

LEVEL, UPRIGHT, EASY = 0.003, 0.03, 0.001
"""w of the root along the floor, of its height and turns, and of hinges: all below 1, the w of soles and mass. Half and double move the zero moment
point of the sample walk by 0.2 mm in the median [-]."""
STEPS, ARRIVED = 8, 1e-3
"""Largest number of Gauss–Newton steps, and the last step that ends them [m, rad]: places then err by its square."""


def steps_alone(ik: BalancedIk, plan: PlaybackPlan) -> Floats:
    """Return (K, nq) configurations with the soles at the places of a plan, the mass over its path and joints within their speeds."""
    robot, model, soles, body = ik.robot, ik.robot.model, ik.soles, ik.robot.root_body
    dofs = np.concatenate([root_dofs(robot), np.flatnonzero(ik.leg_dofs)])
    width, count = len(dofs), 3 * len(soles) + 2
    weights = np.full(model.nv, EASY)
    weights[root_dofs(robot)], weights[root_travel(robot)[:2]] = UPRIGHT, LEVEL
    rows, missing, slope = np.zeros((count + width, width)), np.zeros(count + width), np.zeros((3, model.nv))
    rows[count:] = np.diag(weights[dofs])
    lower, upper = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
    lower[robot.qpos_index], upper[robot.qpos_index] = robot.lower, robot.upper
    data, step, found = mujoco.MjData(model), np.zeros(model.nv), np.array(plan.targets)
    for k, (target, places, centre) in enumerate(zip(plan.targets, plan.places, plan.zmp.centre, strict=True)):
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
            missing[: count - 2] = (places.reshape(-1, 3) - here).ravel()
            missing[count - 2 : count] = centre - data.subtree_com[body, :2]
            missing[count:] = (weights * difference(robot, found[k], target))[dofs]
            step[dofs] = np.linalg.solve(rows.T @ rows, rows.T @ missing)
            found[k] = np.clip(integrate(robot, found[k], step), lower, upper)
            if np.abs(step).max() < ARRIVED:
                break
    reach = ik.options.speed * robot.max_speed / plan.timeline.fps
    found[:, robot.qpos_index] = within_speeds(found[:, robot.qpos_index], reach)
    return found
