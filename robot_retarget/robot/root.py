"""Placement of a robot by its root: a free joint, or any sequence of slides and hinges."""

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.kinematics import body_frames, integrate
from robot_retarget.robot.model import SLIDE, Robot

STEPS = 30
"""Newton steps at most; a free joint takes two, three hinges about five."""
ARRIVED = 1e-9
"""Newton stops after a shorter step [m, rad]."""


def place_body(robot: Robot, qpos: Floats, body: int, offset: Floats, place: Floats, turn: Floats) -> Floats:
    """Move the root so that a body has a given rotation and a point fixed to it a given place.

    A free joint has a closed form. Other roots take Newton steps on  [x(q) − place, log(R turnᵀ)] = 0, in the least-squares
    sense if the root has fewer than six degrees of freedom.

    Args:
        offset: (3,) of the point in the body's frame [m].
        place: (3,) target of the point [m].
        turn: (3, 3) target rotation of the body.
    """
    if robot.floating:
        return _carried(robot, qpos, body, offset, place, turn)
    moved, dofs, data = np.array(qpos), root_dofs(robot), mujoco.MjData(robot.model)
    velocity, rows = np.zeros(robot.model.nv), np.zeros((6, robot.model.nv))
    for _ in range(STEPS if dofs.size else 0):
        data.qpos[:] = moved
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        rotation = data.xmat[body].reshape(3, 3)
        point = data.xpos[body] + rotation @ offset
        mujoco.mj_jac(robot.model, data, rows[:3], rows[3:], point, body)
        missing = np.append(place - point, Rotation.from_matrix(turn @ rotation.T).as_rotvec())
        velocity[dofs] = np.linalg.lstsq(rows[:, dofs], missing)[0]
        moved = integrate(robot, moved, velocity)
        if np.abs(velocity).max() < ARRIVED:
            break
    return moved


def _carried(robot: Robot, qpos: Floats, body: int, offset: Floats, place: Floats, turn: Floats) -> Floats:
    """The same with a free joint: R₁ = turn Rᵀ R₀ and x₁ = place + turn Rᵀ (x₀ − x) for the root's R₀ and x₀."""
    frames, turns = body_frames(robot, qpos[None])
    rotation, root = turn @ turns[0, body].T, robot.root_body
    moved, a = np.array(qpos), robot.root_address
    moved[a : a + 3] = place + rotation @ (frames[0, root] - frames[0, body] - turns[0, body] @ offset)
    mujoco.mju_mat2Quat(moved[a + 3 : a + 7], (rotation @ turns[0, root]).ravel())
    return moved


def raise_root(robot: Robot, qpos: Floats, height: float) -> Floats:
    """A configuration moved up as a whole [m], as far as slides or a free joint carry it upward.

    Args:
        qpos: (nq,) configuration.
        height: upwards [m].
    """
    if robot.floating:
        moved = np.array(qpos)
        moved[robot.root_address + 2] += height
        return moved
    kinds = robot.model.jnt_type
    slides = [d for d in root_dofs(robot) if kinds[robot.model.dof_jntid[d]] == SLIDE]
    dofs = np.array(slides, dtype=np.int64)
    data, velocity, rows = mujoco.MjData(robot.model), np.zeros(robot.model.nv), np.zeros((3, robot.model.nv))
    data.qpos[:] = qpos
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    mujoco.mj_jac(robot.model, data, rows, None, data.xpos[robot.root_body], robot.root_body)
    velocity[dofs] = np.linalg.lstsq(rows[:, dofs], np.array([0.0, 0.0, height]))[0]
    return integrate(robot, qpos, velocity)
