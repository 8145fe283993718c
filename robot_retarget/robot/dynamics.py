"""Ground reaction and joint torques of a motion: the zero moment point from momenta, torques by inverse dynamics."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Bools, Floats, Ints, cross, unit
from robot_retarget.robot.kinematics import Points, body_frames, integrate
from robot_retarget.robot.model import SLIDE, Robot
from robot_retarget.robot.support import CORNERS, Planes, level_planes
from robot_retarget.scene.geoms import SolidGround

UNLOADED = 0.002
"""Height at which a corner carries e⁻² of the load of a corner on the ground [m]: a foot in the air carries nothing.
Half and double change the 99th percentile of the torques of three clips by 4 % at most."""
PLANTED = 3 * UNLOADED
"""Corners this near to the lowest one carry the robot [m]."""
EVENNESS = 1e-3
"""Weight of contact forces [N] against the residual wrench of the root [N, N m]: half and double change the torques of
three clips by less than 0.1 % of the limits."""
SOLE_FRICTION = 0.8
"""Friction that the planted soles may use: half and double change the torques of three clips by 0.3 % of the limits at
most."""


def root_dofs(robot: Robot) -> Ints:
    """Return the indices of the root in qvel."""
    return np.flatnonzero(np.isin(robot.model.dof_jntid, robot.root_joints))


def root_travel(robot: Robot) -> Ints:
    """Return the indices in qvel of the directions along which the root travels; it turns about the others."""
    kinds, own = robot.model.jnt_type[robot.model.dof_jntid], root_dofs(robot)
    first = own - robot.model.jnt_dofadr[robot.model.dof_jntid[own]]
    return own[(kinds[own] == mujoco.mjtJoint.mjJNT_SLIDE) | ((kinds[own] == mujoco.mjtJoint.mjJNT_FREE) & (first < 3))]


def velocities(model: mujoco.MjModel, qpos: Floats, fps: float) -> Floats:
    """(T, nv) by central differences of configurations (T, nq), one-sided at the ends.

    Args:
        model: of a robot, or of a plant.
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
    """
    last, found = len(qpos) - 1, np.zeros((len(qpos), model.nv))
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
    """How a motion presses on the ground, over T frames."""

    point: Floats
    """(T, 2) the zero moment point, seen from above: where the contact forces push [m]."""
    pull: Floats
    """(T,) force along the ground, over that across it [-]."""
    twist: Floats
    """(T,) moment about the normal through the point, over the force across the ground [m]."""

    def friction(self, corners: list[Floats]) -> Floats:
        """(T,) the friction coefficient that T sets of planted corners (N, 3) need: force and moment, at their mean lever."""
        levers = [np.linalg.norm(c[:, :2] - x, axis=1).mean() for c, x in zip(corners, self.point, strict=True)]
        return self.pull + np.abs(self.twist) / np.array(levers)


def tread(robot: Robot, qpos: Floats, fps: float, smooth: float = 0.0, planes: Planes | None = None) -> Tread:
    """Return the ground reaction that a motion (T, nq) needs: its zero moment point on the planes of the contacts (`support`).

        F = Ṗ + m g e_z,   M = L̇ + c × F

    Args:
        smooth: standard deviation of a Gaussian over the momenta [s]; servos cannot follow faster changes.
        planes: of the contacts; the floor z = 0 by default.
    """
    centre, linear, angular = momenta(robot, qpos, velocities(robot.model, qpos, fps))
    known = planes or level_planes(len(qpos))
    if len(qpos) < 3:
        return Tread(centre[:, :2], np.zeros(len(qpos)), np.zeros(len(qpos)))
    if smooth > 0:
        linear, angular = (gaussian_filter1d(a, smooth * fps, axis=0, mode="nearest") for a in (linear, angular))
    mass = robot.model.body_subtreemass[robot.model.body_rootid[robot.root_body]]
    force = np.gradient(linear, 1 / fps, axis=0) - mass * robot.model.opt.gravity
    moment = np.gradient(angular, 1 / fps, axis=0) + cross(centre, force)
    point = known.points(np.concatenate([force, moment], axis=1))
    across = (force * known.surfaces).sum(axis=1)
    pull = np.linalg.norm(force - across[:, None] * known.surfaces, axis=1) / across
    twist = ((moment - cross(point, force)) * known.surfaces).sum(axis=1) / across
    return Tread(point[:, :2], pull, twist)


def joint_torques(
    robot: Robot, qpos: Floats, fps: float, soles: Points, smooth: float = 0.0, ground: SolidGround | None = None
) -> tuple[Floats, Floats]:
    """Return the joint torques (T, n) [N m] of a motion (T, nq) on planted soles, and those at rest in its poses.

    Damping and dry friction are not included: the servo model adds them. `smooth` as in `tread`, over velocities.

    Args:
        qpos: (T, nq) configurations.
        fps: frames per second [1/s].
        soles: corners of the soles.
        smooth: standard deviation of a Gaussian over velocities [s].
        ground: under the soles; the floor alone by default.
    """
    moving = required_forces(robot, qpos, fps, soles, smooth, ground=ground)
    still = np.zeros_like(moving)
    resting = _inverse(robot, (qpos, still, still), soles, np.ones(len(qpos), dtype=bool), ground or SolidGround())
    return moving[:, robot.dof_index], resting[:, robot.dof_index]


def required_forces(
    robot: Robot,
    qpos: Floats,
    fps: float,
    soles: Points,
    smooth: float = 0.0,
    standing: Bools | None = None,
    ground: SolidGround | None = None,
) -> Floats:
    """Return the generalised forces of a motion without the contact forces on the soles.

    Inverse dynamics less contact forces within friction pyramids at the soles, chosen by non-negative least squares to carry
    the root. Entries of hinges are motor torques without damping and friction; entries of the root are its residual wrench,
    which nothing provides.

    Args:
        qpos: (T, nq) configurations.
        smooth: standard deviation of a Gaussian over velocities [s].
        standing: (T,) whether the soles touch the ground; by default in every frame.
        ground: under the soles; the floor alone by default.

    Returns:
        (T, nv) [N, N m].
    """
    qvel = velocities(robot.model, qpos, fps)
    if smooth > 0:
        qvel = gaussian_filter1d(qvel, smooth * fps, axis=0, mode="nearest")
    qacc = np.gradient(qvel, 1 / fps, axis=0) if len(qpos) > 1 else np.zeros_like(qvel)
    stands = np.ones(len(qpos), dtype=bool) if standing is None else standing
    return _inverse(robot, (qpos, qvel, qacc), soles, stands, ground or SolidGround())


def _inverse(
    robot: Robot, motion: tuple[Floats, Floats, Floats], soles: Points, standing: Bools, ground: SolidGround
) -> Floats:
    """(T, nv) inverse dynamics of positions, velocities and accelerations, less the push of the ground."""
    model = copy.copy(robot.model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = 0.0
    data, root, found = mujoco.MjData(model), root_dofs(robot), np.empty(motion[1].shape)
    for t, (q, v, a) in enumerate(zip(*motion, strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        found[t] = data.qfrc_inverse
        if standing[t]:
            found[t] -= ground_push(model, data, soles, root, data.qfrc_inverse[root], ground)
    return found


def ground_push(
    model: mujoco.MjModel, data: mujoco.MjData, soles: Points, root: Ints, wrench: Floats, ground: SolidGround
) -> Floats:
    """(nv,) generalised force of the ground on the planted corners that together push the root by `wrench` (6,).

    Args:
        model: the compiled model.
        data: the robot's poses.
        soles: corners of the soles, four of each foot.
        root: (6,) indices of the root in qvel.
        wrench: (6,) on the root [N, N m].
        ground: under the soles.
    """
    from scipy.optimize import nnls  # imported here: it takes longer to load than many clips to solve

    places = data.xpos[soles.bodies] + np.einsum("kij,kj->ki", data.xmat[soles.bodies].reshape(-1, 3, 3), soles.offsets)
    found = [ground.footing(sole) for sole in places.reshape(-1, CORNERS, 3)]
    bodies = np.repeat(soles.bodies[::CORNERS], [len(points) for points, _, _ in found])
    points, height, normals = (np.concatenate(part) for part in zip(*found, strict=True))
    height = height - height.min()
    planted = np.flatnonzero(height < PLANTED)
    jacobians = np.zeros((len(planted), 3, model.nv))
    for k, rows in zip(planted, jacobians, strict=True):
        mujoco.mj_jac(model, data, rows, None, points[k], int(bodies[k]))
    edges = np.exp(-height[planted] / UNLOADED)[:, None, None] * _pyramids(normals[planted])
    generators = (edges @ jacobians).reshape(-1, model.nv).T
    # Two feet can share a load in many ways: the ridge picks the evenest of those that stand, which changes smoothly.
    ridge = EVENNESS * np.eye(generators.shape[1])
    share, _ = nnls(np.concatenate([generators[root], ridge]), np.append(wrench, np.zeros(len(ridge))))
    return generators @ share


def _pyramids(normals: Floats) -> Floats:
    """Return (P, 4, 3) edges of the friction pyramids on surfaces with normals (P, 3) that point up."""
    ahead = unit(normals[:, [2, 1, 0]] * [1.0, 0.0, -1.0])
    left = cross(normals, ahead)
    return normals[:, None] + SOLE_FRICTION * np.stack([ahead, -ahead, left, -left], axis=1)


# Placement of a robot by its root: a free joint, or any sequence of slides and hinges.

STEPS = 30
"""Newton steps at most; a free joint takes 2, three hinges about 5."""
SHORT_STEP = 1e-9
"""Newton stops after a shorter step [m, rad]."""


Placer = Callable[[Floats, Floats], Floats]
"""From the place (3,) of a point [m] and the rotation (3, 3) of its body to a configuration (nq,)."""


def body_placer(robot: Robot, qpos: Floats, body: int, offset: Floats) -> Placer:
    """Return what moves the root of a pose so that a body has a given rotation and a point fixed to it a given place.

    A free joint has a closed form, and needs forward kinematics once. Other roots take Newton steps on
    [x(q) − place, log(R turnᵀ)] = 0, in the least-squares sense if the root has fewer than six degrees of freedom.

    Args:
        qpos: (nq,) the pose.
        offset: (3,) of the point in the body's frame [m].
    """
    if not robot.floating:
        return partial(_stepped, robot, qpos, body, offset)
    (frames,), (turns,) = body_frames(robot, qpos[None])
    back, root, a = turns[body].T, robot.root_body, robot.root_address
    away, turned = back @ (frames[root] - frames[body]) - offset, back @ turns[root]  # of the root, seen from the point

    def placed(place: Floats, turn: Floats) -> Floats:
        moved = np.array(qpos)
        moved[a : a + 3] = place + turn @ away
        mujoco.mju_mat2Quat(moved[a + 3 : a + 7], (turn @ turned).ravel())
        return moved

    return placed


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
        if np.abs(velocity).max() < SHORT_STEP:
            break
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
