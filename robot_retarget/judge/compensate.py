"""Lag compensation: compute the goals that make the joints follow the trajectory in time.

    u(t) = q(t') + (τ(t') + f tanh(ω(t') / ω_f) − b ω(t')) / k_p,    t' = t + delay + half a goal's hold

τ comes from inverse dynamics along the motion (inertia, gravity, damping), f is the dry friction, b the servo's own
speed term. On the ground the planted soles provide the root's part of the inverse dynamics, and their push loads
the legs: forces within friction pyramids at the soles' corners, by non-negative least squares.
"""

import copy

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.goals import Playback, settled
from robot_retarget.judge.grasp import grasp_pushes
from robot_retarget.judge.plant import Mode, Plant, limb_inertia
from robot_retarget.judge.torque_limited_reference import torque_limited_reference
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.dynamics import ground_push
from robot_retarget.robot.model import FREE
from robot_retarget.robot.support import feet_of
from robot_retarget.trajectory import Trajectory

SMOOTHING = 0.02
"""Inverse dynamics uses accelerations averaged over a window of this standard deviation [s]; servos do not follow faster ones."""
SLOW = 0.05
"""Dry friction reverses within ± this speed [rad/s]."""
USABLE = 0.95
"""Of the torque bound that a goal may ask for."""


def compensated(plant: Plant, trajectory: Trajectory, mode: Mode = "pinned", playback: Playback | None = None) -> Goals:
    """Return the goals that make the servos follow a trajectory, at the playback's rate: inverse dynamics undoes lag and sag.

    The first and the last goal hold their poses at rest, and are repeated for the time of settling.
    """
    playback = playback or Playback()
    rate = playback.on(plant)
    states = _states(plant, _spline(plant, trajectory, rate), trajectory.fps / rate)
    torque, speed = _torques(plant, states, rate, mode)
    change = _changes(plant, torque, 1 / rate)
    if change.any():
        states[:, plant.hinges] += change
        torque, speed = _torques(plant, states, rate, mode)
    friction = plant.model.dof_frictionloss[plant.dofs] * np.tanh(speed / SLOW)
    leads = plant.goal_offsets(torque + friction, speed)
    return settled(plant, _ahead(states[:, plant.hinges] + leads, rate, playback.delay), playback)


def _spline(plant: Plant, trajectory: Trajectory, rate: float) -> Floats:
    """(N, nq) at the playback's rate, twice differentiable between frames, where `timing.sample` is straight."""
    count = max(round(trajectory.duration * rate), 1) + 1
    if len(trajectory) == 1:
        return np.tile(trajectory.qpos, (count, 1))
    at = np.minimum(np.arange(count) / rate, trajectory.duration)
    frames = np.arange(len(trajectory)) / trajectory.fps
    qpos = CubicSpline(frames, trajectory.qpos, bc_type="clamped")(at)
    model = plant.robot.model
    for joint in np.flatnonzero(model.jnt_type == FREE):
        columns = slice(int(model.jnt_qposadr[joint]) + 3, int(model.jnt_qposadr[joint]) + 7)
        turns = Rotation.from_quat(trajectory.qpos[:, columns], scalar_first=True)
        qpos[:, columns] = RotationSpline(frames, turns)(at).as_quat(scalar_first=True)
    return qpos


def _states(plant: Plant, qpos: Floats, frames: float) -> Floats:
    """Return configurations of the plant's model at configurations (N, nq) of the robot, `frames` apart, with free bodies on their paths."""
    states = plant.places.model_qpos(qpos)
    if plant.bodies is not None:
        states[:, plant.bodies.coordinates] = plant.bodies.free_paths(frames * np.arange(len(qpos), dtype=np.float64))
    return states


def _rates(model: mujoco.MjModel, states: Floats, rate: float) -> tuple[Floats, Floats]:
    """Velocities and accelerations (N, nv), at rest at both ends."""
    qvel = np.zeros((len(states), model.nv))
    for k in range(1, len(states) - 1):
        mujoco.mj_differentiatePos(model, qvel[k], 2 / rate, states[k - 1], states[k + 1])
    qacc = gaussian_filter1d(np.gradient(qvel, 1 / rate, axis=0), SMOOTHING * rate, axis=0, mode="nearest")
    qacc[[0, -1]] = 0
    return qvel, qacc


def _changes(plant: Plant, torque: Floats, dt: float) -> Floats:
    """(N, n) by how much the joints must leave the motion for their servos to follow [rad]."""
    inertia, damping = limb_inertia(plant.robot, plant.model), plant.model.dof_damping[plant.dofs]
    bounds = plant.bounds
    changes = np.zeros_like(torque)
    for k in plant.driven:
        if np.isfinite(bounds[k]):
            swung, braked = float(inertia[k]), float(damping[k])
            changes[:, k] = torque_limited_reference(torque[:, k], USABLE * float(bounds[k]), swung, braked, dt)
    return changes


def _torques(plant: Plant, states: Floats, rate: float, mode: Mode) -> tuple[Floats, Floats]:
    """Return the torques of the servos (N, n) [N m] and their speeds (N, n) [rad/s] in configurations (N, nq) of the plant's model."""
    model = copy.copy(plant.model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, places = mujoco.MjData(model), plant.places
    qvel, qacc = _rates(plant.model, states, rate)
    soles = feet_of(plant.robot).corners if mode == "free" else None
    root, links, ground = plant.root_dofs, _Links(plant), plant.ground
    if mode == "pinned":
        held = np.setdiff1d(places.dofs, plant.dofs)
        qvel[:, held] = qacc[:, held] = 0
    pushes = grasp_pushes(plant, states, qvel, qacc, rate)
    torque, configurations = np.empty((len(states), len(plant.dofs))), places.configuration(states)
    for k in range(len(states)):
        data.qpos[:], data.qvel[:], data.qacc[:] = states[k], qvel[k], qacc[k]
        mujoco.mj_inverse(model, data)
        force = data.qfrc_inverse - pushes[k]
        if soles is not None and len(soles):
            force -= ground_push(model, data, soles, root, force[root], ground)
        torque[k] = links.driven(configurations[k], force[places.dofs])[plant.robot.dof_index]
    return torque, qvel[:, plant.dofs]


class _Links:
    """Hinges that no servo drives hang on others by gears and closed chains: their load goes to those.

    With J the Jacobian of the coupling, forces τ + Jᵀλ have the same effect; λ makes the forces of the loose hinges zero.
    """

    def __init__(self, plant: Plant):
        driven = plant.robot.dof_index[plant.driven]
        self._loose = np.setdiff1d(plant.robot.dof_index, driven)
        self._coupling = Coupling(plant.robot)

    def driven(self, qpos: Floats, force: Floats) -> Floats:
        """The same effect (nv,) with no force on loose hinges, at best."""
        if not self._loose.size or not self._coupling.present:
            return force
        _, slope = self._coupling(qpos)
        pull, *_ = np.linalg.lstsq(slope[:, self._loose].T, -force[self._loose], rcond=1e-6)
        return force + slope.T @ pull


def _ahead(goals: Floats, rate: float, delay: float) -> Floats:
    """Send goals (N, n) early by the delay and half a hold; both ends are unchanged."""
    at = np.arange(len(goals)) + (delay * rate + 0.5)
    sent = np.stack([np.interp(at, np.arange(len(goals)), column) for column in goals.T], axis=1)
    sent[0] = goals[0]
    return sent
