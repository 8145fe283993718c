"""Ground reaction and joint torques of a motion: the zero moment point from momenta, torques by inverse dynamics."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import nnls

from robot_retarget.arrays import Bools, Floats, Ints
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot

NEAR = 0.002
"""Height at which a corner carries e⁻² of the load of a corner on the floor [m]: a foot in the air carries nothing."""
PLANTED = 3 * NEAR
"""Corners this near to the lowest one carry the robot [m]."""
EVENNESS = 1e-3
"""Weight of contact forces [N] against the residual wrench of the root [N, N m]."""
GRIP = 0.8
"""Friction that the planted soles may use."""


def root_dofs(robot: Robot) -> Ints:
    """Return the indices of the root in qvel."""
    return np.flatnonzero(np.isin(robot.model.dof_jntid, robot.root_joints))


def velocities(robot: Robot, qpos: Floats, fps: float) -> Floats:
    """(T, nv) by central differences of configurations (T, nq), one-sided at the ends.

    Args:
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
    """
    model, last = robot.model, len(qpos) - 1
    found = np.zeros((len(qpos), model.nv))
    for t in range(len(qpos) if last else 0):
        before, after = max(t - 1, 0), min(t + 1, last)
        mujoco.mj_differentiatePos(model, found[t], (after - before) / fps, qpos[before], qpos[after])
    return found


def momenta(robot: Robot, qpos: Floats, qvel: Floats) -> tuple[Floats, Floats, Floats]:
    """Centre of mass (T, 3) [m], linear momentum (T, 3) [kg m/s] and angular momentum about it (T, 3) [kg m²/s].

    Args:
        qpos: (T, nq) configurations.
        qvel: (T, nv) velocities.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    tree = int(model.body_rootid[robot.root_body])
    found = np.empty((3, len(qpos), 3))
    for t, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_subtreeVel):
            stage(model, data)
        linear = model.body_subtreemass[tree] * data.subtree_linvel[tree]
        found[:, t] = data.subtree_com[tree], linear, data.subtree_angmom[tree]
    return found[0], found[1], found[2]


@dataclass(frozen=True)
class Tread:
    """How a motion presses on the floor z = 0, over T frames."""

    point: Floats
    """(T, 2) the zero moment point: where the contact forces push [m]."""
    pull: Floats
    """(T, 2) force along the floor, over that across it [-]."""
    twist: Floats
    """(T,) moment about the vertical through the point, over the force across the floor [m]."""

    def friction(self, corners: list[Floats]) -> Floats:
        """(T,) the friction coefficient that T sets of planted corners (N, 3) need: force and moment, at their mean lever."""
        levers = [np.linalg.norm(c[:, :2] - x, axis=1).mean() for c, x in zip(corners, self.point, strict=True)]
        return np.linalg.norm(self.pull, axis=1) + np.abs(self.twist) / np.array(levers)


def tread(robot: Robot, qpos: Floats, fps: float, smooth: float = 0.0) -> Tread:
    """Return the ground reaction that a motion (T, nq) needs.

        p_x = c_x − (c_z F_x + L̇_y)/F_z,   p_y = c_y − (c_z F_y − L̇_x)/F_z,   F = Ṗ + m g e_z
        M_z = L̇_z + (c_x − p_x) F_y − (c_y − p_y) F_x

    Args:
        smooth: standard deviation of a Gaussian over the momenta [s]; servos cannot follow faster changes.
    """
    centre, linear, angular = momenta(robot, qpos, velocities(robot, qpos, fps))
    if len(qpos) < 3:
        return Tread(centre[:, :2], np.zeros((len(qpos), 2)), np.zeros(len(qpos)))
    if smooth > 0:
        linear, angular = (gaussian_filter1d(a, smooth * fps, axis=0, mode="nearest") for a in (linear, angular))
    mass = robot.model.body_subtreemass[robot.model.body_rootid[robot.root_body]]
    force = np.gradient(linear, 1 / fps, axis=0) - mass * robot.model.opt.gravity
    turning = np.gradient(angular, 1 / fps, axis=0)
    height, across = centre[:, 2:], force[:, 2]
    arm = (height * force[:, :2] + np.stack([turning[:, 1], -turning[:, 0]], axis=1)) / across[:, None]
    twist = turning[:, 2] + arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    return Tread(centre[:, :2] - arm, force[:, :2] / across[:, None], twist / across)


def zero_moment_points(robot: Robot, qpos: Floats, fps: float, smooth: float = 0.0) -> Floats:
    """(T, 2) where on the floor z = 0 the contact forces push [m]; see `tread`.

    Args:
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
        smooth: standard deviation of a Gaussian over velocities [s].
    """
    return tread(robot, qpos, fps, smooth).point


def joint_torques(robot: Robot, qpos: Floats, fps: float, soles: Points, smooth: float = 0.0) -> tuple[Floats, Floats]:
    """Return the joint torques (T, n) [N m] of a motion (T, nq) on planted soles, and those at rest in its poses.

    Damping and dry friction are not included: the servo model adds them. `smooth` as in `tread`, over velocities.

    Args:
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
        soles: corners of the soles.
        smooth: standard deviation of a Gaussian over velocities [s].
    """
    moving = required_forces(robot, qpos, fps, soles, smooth)
    still = np.zeros_like(moving)
    resting = _inverse(robot, (qpos, still, still), soles, np.ones(len(qpos), dtype=bool))
    return moving[:, robot.dof_index], resting[:, robot.dof_index]


def required_forces(
    robot: Robot, qpos: Floats, fps: float, soles: Points, smooth: float = 0.0, standing: Bools | None = None
) -> Floats:
    """Return the generalised forces of a motion without the contact forces on the soles.

    Inverse dynamics less contact forces within friction pyramids at the soles, chosen by non-negative least squares to carry
    the root. Entries of hinges are motor torques without damping and friction; entries of the root are its residual wrench,
    which nothing provides.

    Args:
        qpos: (T, nq) configurations.
        smooth: standard deviation of a Gaussian over velocities [s].
        standing: (T,) whether the soles touch the floor; by default in every frame.

    Returns:
        (T, nv) [N, N m].
    """
    qvel = velocities(robot, qpos, fps)
    if smooth > 0:
        qvel = gaussian_filter1d(qvel, smooth * fps, axis=0, mode="nearest")
    qacc = np.gradient(qvel, 1 / fps, axis=0) if len(qpos) > 1 else np.zeros_like(qvel)
    return _inverse(robot, (qpos, qvel, qacc), soles, np.ones(len(qpos), dtype=bool) if standing is None else standing)


def _inverse(robot: Robot, motion: tuple[Floats, Floats, Floats], soles: Points, standing: Bools) -> Floats:
    """(T, nv) inverse dynamics of positions, velocities and accelerations, less the push of the floor."""
    model = copy.copy(robot.model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    data, root, found = mujoco.MjData(model), root_dofs(robot), np.empty(motion[1].shape)
    for t, (q, v, a) in enumerate(zip(*motion, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        found[t] = data.qfrc_inverse
        if standing[t]:
            found[t] -= floor_push(model, data, soles, root, data.qfrc_inverse[root])
    return found


def floor_push(model: mujoco.MjModel, data: mujoco.MjData, soles: Points, root: Ints, wrench: Floats) -> Floats:
    """(nv,) generalised force of the floor on the planted corners that together push the root by `wrench` (6,).

    Args:
        model: the compiled model.
        data: the robot's poses.
        soles: corners of the soles.
        root: (6,) indices of the root in qvel.
        wrench: (6,) on the root [N, N m].
    """
    places = data.xpos[soles.bodies] + np.einsum("kij,kj->ki", data.xmat[soles.bodies].reshape(-1, 3, 3), soles.offsets)
    height = places[:, 2] - places[:, 2].min()
    planted = np.flatnonzero(height < PLANTED)
    edges = np.array([[GRIP, 0, 1], [-GRIP, 0, 1], [0, GRIP, 1], [0, -GRIP, 1]])
    jacobian, columns = np.zeros((3, model.nv)), []
    for k in planted:
        mujoco.mj_jac(model, data, jacobian, None, places[k], int(soles.bodies[k]))
        columns.append(np.exp(-height[k] / NEAR) * jacobian.T @ edges.T)
    generators = np.hstack(columns)
    # Two feet can share a load in many ways: the ridge picks the evenest of those that stand, which changes smoothly.
    ridge = EVENNESS * np.eye(generators.shape[1])
    share, _ = nnls(np.vstack([generators[root], ridge]), np.concatenate([wrench, np.zeros(len(ridge))]))
    return generators @ share
