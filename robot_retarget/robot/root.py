"""Placement of a robot by its root: a free joint, or any sequence of slides and hinges."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.kinematics import body_frames, integrate
from robot_retarget.robot.model import SLIDE, Robot

STEPS = 30
"""Newton steps at most; a free joint takes two, three hinges about five."""
ARRIVED = 1e-9
"""Newton stops after a shorter step [m, rad]."""


Placer = Callable[[Floats, Floats], Floats]
"""From the place (3,) of a point [m] and the rotation (3, 3) of its body to a configuration (nq,)."""


def place_body(robot: Robot, qpos: Floats, body: int, offset: Floats, place: Floats, turn: Floats) -> Floats:
    """Move the root so that a body has a given rotation and a point fixed to it a given place.

    A free joint has a closed form. Other roots take Newton steps on  [x(q) − place, log(R turnᵀ)] = 0, in the least-squares
    sense if the root has fewer than six degrees of freedom.

    Args:
        offset: (3,) of the point in the body's frame [m].
        place: (3,) target of the point [m].
        turn: (3, 3) target rotation of the body.
    """
    return body_placer(robot, qpos, body, offset)(place, turn)


def body_placer(robot: Robot, qpos: Floats, body: int, offset: Floats) -> Placer:
    """Return `place_body` of one pose, for many places: a free joint needs forward kinematics once."""
    if robot.floating:
        return FreePose.of(robot, qpos, body, offset).placed
    return partial(_stepped, robot, qpos, body, offset)


def _stepped(robot: Robot, qpos: Floats, body: int, offset: Floats, place: Floats, turn: Floats) -> Floats:
    """Return the configuration by Newton steps."""
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


@dataclass(frozen=True, eq=False)
class FreePose:
    """A pose of a robot with a free joint, which is placed by a point of a body with x, R: the root has R₀ and x₀."""

    qpos: Floats
    """(nq,)."""
    address: int
    """Where the root's coordinates begin."""
    away: Floats
    """(3,) Rᵀ (x₀ − x) [m]."""
    turned: Floats
    """(3, 3) Rᵀ R₀."""

    @classmethod
    def of(cls, robot: Robot, qpos: Floats, body: int, offset: Floats) -> "FreePose":
        """Return a pose (nq,) placed by a point of a body, at an offset (3,) in its frame [m]."""
        (frames,), (turns,) = body_frames(robot, qpos[None])
        back, root = turns[body].T, robot.root_body
        return cls(qpos, robot.root_address, back @ (frames[root] - frames[body]) - offset, back @ turns[root])

    def placed(self, place: Floats, turn: Floats) -> Floats:
        """Return the pose (nq,) with the point at `place` (3,) [m] and the body turned by `turn` (3, 3)."""
        moved, a = np.array(self.qpos), self.address
        moved[a : a + 3] = place + turn @ self.away
        mujoco.mju_mat2Quat(moved[a + 3 : a + 7], (turn @ self.turned).ravel())
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
