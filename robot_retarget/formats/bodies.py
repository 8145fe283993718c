"""Poses and velocities of bodies as trainers read them, in the orders of MuJoCo and Isaac Lab."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.robot.model import HINGE, SLIDE, Robot


def robot_bodies(robot: Robot) -> Ints:
    """(B,) ids of the robot's bodies without the world, depth first; its root stands first."""
    model, root = robot.model, robot.root_body
    return np.flatnonzero(model.body_rootid == model.body_rootid[root]).astype(np.int64)


def body_names(robot: Robot, bodies: Ints) -> tuple[str, ...]:
    """Their names."""
    return tuple(robot.model.body(int(body)).name for body in bodies)


def breadth_first_bodies(robot: Robot) -> Ints:
    """(B,) the same ids level by level, each level in the order of its parents."""
    bodies, ordered = robot_bodies(robot), list[int]()
    level = [int(bodies[0])]
    while level:
        ordered += level
        level = [int(body) for parent in level for body in bodies[1:] if robot.model.body_parentid[body] == parent]
    return np.array(ordered, dtype=np.int64)


def breadth_first_hinges(robot: Robot) -> Ints:
    """(n,) which of the robot's hinges stands where when bodies go breadth first."""
    rank = {int(body): k for k, body in enumerate(breadth_first_bodies(robot))}
    return np.argsort([rank[int(robot.model.jnt_bodyid[j])] for j in robot.joint_ids], kind="stable")


@dataclass(frozen=True)
class BodyTracks:
    """Every body of the model, the world first, over time, in the world's axes."""

    positions: Floats
    """(T, B, 3) of the frames' origins [m]."""
    quaternions: Floats
    """(T, B, 4) w x y z."""
    linear: Floats
    """(T, B, 3) velocities of the frames' origins [m/s]."""
    linear_of_mass: Floats
    """(T, B, 3) velocities of the centres of mass [m/s]."""
    angular: Floats
    """(T, B, 3) [rad/s]."""
    spatial: Floats
    """(T, B, 6) MuJoCo's `cvel`: angular, then linear at the centre of mass of the tree."""
    subtree_mass_centres: Floats
    """(T, B, 3) MuJoCo's `subtree_com` [m]."""


def central(values: Floats, fps: float) -> Floats:
    """(T, …) ẋ_t = (x_{t+1} − x_{t−1}) f / 2, at the ends (x_1 − x_0) f and (x_{T−1} − x_{T−2}) f."""
    return np.gradient(values, 1 / fps, axis=0) if len(values) > 1 else np.zeros_like(values)


def turning(quaternions: Floats, fps: float) -> Floats:
    """(T, 3) ω_t = log(q_{t+1} q_{t−1}⁻¹) f / 2 in the world's axes; the ends repeat their neighbours [rad/s]."""
    if len(quaternions) < 3:
        step = max(len(quaternions) - 1, 1)
        turns = Rotation.from_quat(quaternions, scalar_first=True)
        return np.tile((turns[-1] * turns[0].inv()).as_rotvec() * fps / step, (len(quaternions), 1))
    turns = Rotation.from_quat(quaternions, scalar_first=True)
    inner = (turns[2:] * turns[:-2].inv()).as_rotvec() * fps / 2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def velocities(motion: RobotMotion) -> Floats:
    """(T, nv) MuJoCo's qvel: `central` of positions and joints, `turning` of the root in the root's own axes."""
    robot, model = motion.robot, motion.robot.model
    qvel = np.zeros((len(motion), model.nv))
    single = np.isin(model.jnt_type, (SLIDE, HINGE))
    qvel[:, model.jnt_dofadr[single]] = central(motion.qpos[:, model.jnt_qposadr[single]], motion.fps)
    if robot.floating:
        dof = int(model.jnt_dofadr[robot.root_joints[0]])
        qvel[:, dof : dof + 3] = central(motion.position, motion.fps)
        spin = turning(motion.quaternion, motion.fps)
        qvel[:, dof + 3 : dof + 6] = Rotation.from_quat(motion.quaternion, scalar_first=True).inv().apply(spin)
    return qvel


def body_tracks(motion: RobotMotion, qvel: Floats) -> BodyTracks:
    """Poses and velocities of every body at every frame, by MuJoCo's kinematics.

    Args:
        qvel: (T, nv), as `velocities` gives it.
    """
    model, data, count = motion.robot.model, mujoco.MjData(motion.robot.model), motion.robot.model.nbody
    found = BodyTracks(*(np.zeros((len(motion), count, width)) for width in (3, 4, 3, 3, 3, 6, 3)))
    six = np.zeros(6)
    for t in range(len(motion)):
        data.qpos[:], data.qvel[:] = motion.qpos[t], qvel[t]
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            stage(model, data)
        found.positions[t], found.quaternions[t] = data.xpos, data.xquat
        found.spatial[t], found.subtree_mass_centres[t] = data.cvel, data.subtree_com
        for body in range(count):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, six, 0)
            found.angular[t, body], found.linear[t, body] = six[:3], six[3:]
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, six, 0)
            found.linear_of_mass[t, body] = six[3:]
    return found


def onward_velocities(motion: RobotMotion) -> Floats:
    """(T, nv) MuJoCo's qvel from each frame to the next, q_t ⊕ v_t / f = q_{t+1}; the last frame repeats the one before."""
    found = np.zeros((len(motion), motion.robot.model.nv))
    for t in range(len(motion) - 1):
        mujoco.mj_differentiatePos(motion.robot.model, found[t], 1 / motion.fps, motion.qpos[t], motion.qpos[t + 1])
    found[-1] = found[max(len(motion) - 2, 0)]
    return found


def motor_tracks(motion: RobotMotion, qvel: Floats) -> tuple[Floats, Floats]:
    """(T, nu) lengths of the actuators [rad or m] and (T, nu) their rates, by MuJoCo's transmissions."""
    model, data = motion.robot.model, mujoco.MjData(motion.robot.model)
    lengths, rates = np.zeros((len(motion), model.nu)), np.zeros((len(motion), model.nu))
    for t in range(len(motion)):
        data.qpos[:], data.qvel[:] = motion.qpos[t], qvel[t]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        lengths[t], rates[t] = data.actuator_length, data.actuator_velocity
    return lengths, rates


def site_tracks(motion: RobotMotion) -> tuple[Floats, Floats]:
    """(T, S, 3) places of the model's sites [m] and (T, S, 9) their rotations, row by row."""
    model, data = motion.robot.model, mujoco.MjData(motion.robot.model)
    places, turns = np.zeros((len(motion), model.nsite, 3)), np.zeros((len(motion), model.nsite, 9))
    for t in range(len(motion)):
        data.qpos[:] = motion.qpos[t]
        mujoco.mj_kinematics(model, data)
        places[t], turns[t] = data.site_xpos, data.site_xmat
    return places, turns
