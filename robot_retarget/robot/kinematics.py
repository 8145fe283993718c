"""The one forward kinematics: CasADi expressions of an MJCF's body frames and of points fixed to them.

A configuration q is moved by a tangent vector v of MuJoCo's velocity space, q ⊕ v (`mj_integratePos` over one
second): free joints translate in the world frame and turn in their own, single joints add. Every function takes q and
differentiates by v, so that quaternions need no special care anywhere else.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot.model import FREE, HINGE, Robot


@dataclass(frozen=True)
class Points:
    """Points fixed to bodies."""

    bodies: Ints
    """(P,) body ids."""
    offsets: Floats
    """(P, 3) in the body's frame [m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", frozen(self.bodies, np.int64))
        object.__setattr__(self, "offsets", frozen(np.reshape(self.offsets, (-1, 3))))

    def __len__(self) -> int:
        return len(self.bodies)


def body_frames(robot: Robot, qpos: Floats) -> tuple[Floats, Floats]:
    """World positions (T, B, 3) [m] and rotations (T, B, 3, 3) of every body at qpos (T, nq), by MuJoCo."""
    model, data = robot.model, mujoco.MjData(robot.model)
    positions, rotations = np.empty((len(qpos), model.nbody, 3)), np.empty((len(qpos), model.nbody, 3, 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        positions[t], rotations[t] = data.xpos, data.xmat.reshape(-1, 3, 3)
    return positions, rotations


def world_points(robot: Robot, points: Points, qpos: Floats) -> Floats:
    """World positions (T, P, 3) [m] of points at qpos (T, nq)."""
    positions, rotations = body_frames(robot, qpos)
    turned = np.einsum("tpij,pj->tpi", rotations[:, points.bodies], points.offsets)
    return positions[:, points.bodies] + turned


def point_function(robot: Robot, points: Points) -> ca.Function:
    """q (nq) ↦ positions (3P, stacked x y z per point) [m] and their Jacobian by v (3P, nv)."""
    q, v = ca.SX.sym("q", robot.model.nq), ca.SX.sym("v", robot.model.nv)
    stacked = _stacked(robot, points, q, v)
    at_rest = ca.substitute([stacked, ca.jacobian(stacked, v)], [v], [ca.SX.zeros(robot.model.nv)])
    return ca.Function("points", [q], at_rest, ["q"], ["x", "J"])


def mass_function(robot: Robot) -> ca.Function:
    """q (nq) ↦ the centre of mass of the robot  Σ m_b c_b / Σ m_b  (3) [m] and its Jacobian by v (3, nv)."""
    model = robot.model
    q, v = ca.SX.sym("q", model.nq), ca.SX.sym("v", model.nv)
    frames = _symbolic_frames(model, q, v)
    heavy = np.flatnonzero((model.body_rootid == model.body_rootid[robot.root_body]) & (model.body_mass > 0))
    shares = model.body_mass[heavy] / model.body_mass[heavy].sum()
    centre = ca.SX.zeros(3)
    for (position, rotation), share, offset in zip(
        [frames[int(b)] for b in heavy], shares, model.body_ipos[heavy], strict=True
    ):
        centre += float(share) * (position + rotation @ ca.DM(offset))
    at_rest = ca.substitute([centre, ca.jacobian(centre, v)], [v], [ca.SX.zeros(model.nv)])
    return ca.Function("mass", [q], at_rest, ["q"], ["x", "J"])


def place_function(robot: Robot, points: Points) -> ca.Function:
    """q (nq) ↦ the positions alone (3P): a quarter of the work."""
    q = ca.SX.sym("q", robot.model.nq)
    return ca.Function("places", [q], [_stacked(robot, points, q, ca.SX.zeros(robot.model.nv))], ["q"], ["x"])


def _stacked(robot: Robot, points: Points, q: Any, v: Any) -> Any:
    """Positions of points at q ⊕ v, x y z one point after the other."""
    frames = _symbolic_frames(robot.model, q, v)
    return ca.vertcat(*[p + r @ ca.DM(o) for (p, r), o in _located(frames, points)])


def integrate(robot: Robot, qpos: Floats, velocity: Floats) -> Floats:
    """q ⊕ v: (nq,) moved by the tangent vector (nv,)."""
    moved = np.array(qpos)
    mujoco.mj_integratePos(robot.model, moved, velocity, 1.0)
    return moved


def difference(robot: Robot, start: Floats, end: Floats) -> Floats:
    """The tangent vector (nv,) that leads from one configuration to another: start ⊕ v = end."""
    velocity = np.empty(robot.model.nv)
    mujoco.mj_differentiatePos(robot.model, velocity, 1.0, start, end)
    return velocity


def _located(frames: dict[int, tuple[Any, Any]], points: Points) -> list[tuple[tuple[Any, Any], Floats]]:
    return [(frames[int(b)], o) for b, o in zip(points.bodies, points.offsets, strict=True)]


def _symbolic_frames(model: mujoco.MjModel, q: Any, v: Any) -> dict[int, tuple[Any, Any]]:
    """Position and rotation of each body at q ⊕ v, exact to first order in v (all that a Jacobian needs)."""
    frames: dict[int, tuple[Any, Any]] = {0: (ca.SX.zeros(3), ca.SX.eye(3))}
    for body in range(1, model.nbody):
        position, rotation = frames[int(model.body_parentid[body])]
        position = position + rotation @ ca.DM(model.body_pos[body])
        rotation = rotation @ ca.DM(_matrix(tuple(model.body_quat[body])))
        for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            position, rotation = _moved(model, joint, q, v, position, rotation)
        frames[body] = position, rotation
    return frames


def _moved(model: mujoco.MjModel, joint: int, q: Any, v: Any, position: Any, rotation: Any) -> tuple[Any, Any]:
    """A body frame carried on by one of its joints."""
    a, d = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    if model.jnt_type[joint] == FREE:
        return q[a : a + 3] + v[d : d + 3], _quaternion(q[a + 3 : a + 7]) @ (ca.SX.eye(3) + ca.skew(v[d + 3 : d + 6]))
    step = q[a] + v[d] - float(model.qpos0[a])
    axis, anchor = ca.DM(model.jnt_axis[joint]), ca.DM(model.jnt_pos[joint])
    if model.jnt_type[joint] == HINGE:
        turned = rotation @ _about(axis, step)
        return position + rotation @ anchor - turned @ anchor, turned
    return position + rotation @ axis * step, rotation


def _about(axis: Any, angle: Any) -> Any:
    """Rodrigues: the rotation by `angle` about a unit axis."""
    k = ca.skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * (k @ k)


def _quaternion(wxyz: Any) -> Any:
    """The rotation of a quaternion, normalised as MuJoCo does."""
    unit = wxyz / ca.norm_2(wxyz)
    w, u = unit[0], unit[1:4]
    k = ca.skew(u)
    return ca.SX.eye(3) + 2 * w * k + 2 * (k @ k)


@lru_cache(maxsize=4096)
def _matrix(wxyz: tuple[float, ...]) -> Floats:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(wxyz))
    return matrix.reshape(3, 3)
