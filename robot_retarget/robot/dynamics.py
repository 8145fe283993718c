"""What the floor must do for a motion to happen: the zero moment point, by MuJoCo's momenta."""

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.robot.model import Robot


def velocities(robot: Robot, qpos: Floats, fps: float) -> Floats:
    """(T, nv) by central differences of configurations (T, nq), one-sided at the ends."""
    model, last = robot.model, len(qpos) - 1
    found = np.zeros((len(qpos), model.nv))
    for t in range(len(qpos) if last else 0):
        before, after = max(t - 1, 0), min(t + 1, last)
        mujoco.mj_differentiatePos(model, found[t], (after - before) / fps, qpos[before], qpos[after])
    return found


def momenta(robot: Robot, qpos: Floats, qvel: Floats) -> tuple[Floats, Floats, Floats]:
    """Centre of mass (T, 3) [m], linear momentum (T, 3) [kg m/s] and angular momentum about it (T, 3) [kg m²/s]."""
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


def zero_moment_points(robot: Robot, qpos: Floats, fps: float, smooth: float = 0.0) -> Floats:
    """(T, 2) where on the floor z = 0 the contact forces push [m].

        p_x = c_x − (c_z F_x + L̇_y)/F_z,   p_y = c_y − (c_z F_y − L̇_x)/F_z,   F = Ṗ + m g e_z

    Args:
        smooth: standard deviation of a Gaussian over the momenta [s]; servos cannot follow what is quicker.
    """
    if len(qpos) < 3:
        return momenta(robot, qpos, velocities(robot, qpos, fps))[0][:, :2]
    centre, linear, angular = momenta(robot, qpos, velocities(robot, qpos, fps))
    if smooth > 0:
        linear, angular = (gaussian_filter1d(a, smooth * fps, axis=0, mode="nearest") for a in (linear, angular))
    mass = robot.model.body_subtreemass[robot.model.body_rootid[robot.root_body]]
    force = np.gradient(linear, 1 / fps, axis=0) - mass * robot.model.opt.gravity
    turning = np.gradient(angular, 1 / fps, axis=0)
    height = centre[:, 2:]
    lever = height * force[:, :2] + np.stack([turning[:, 1], -turning[:, 0]], axis=1)
    return centre[:, :2] - lever / force[:, 2:]
