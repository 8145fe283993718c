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
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.bodies import SimulatedBodies
from robot_retarget.judge.plant import Mode, Plant, limb_inertia
from robot_retarget.judge.playback import Playback, settled
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.dynamics import EVENNESS, ground_push, velocities
from robot_retarget.robot.model import FREE
from robot_retarget.robot.support import feet_of
from robot_retarget.scene.geoms import RESTING
from robot_retarget.trajectory import Trajectory

# The nearest motion that a servo can follow: its torque stays within the bound over the whole clip.
#
#     minimise ½ ‖y‖²   subject to   −b − τ ≤ A y ≤ b − τ,      A = J D₂ + d D₁
#
# for the change y of one joint's angles over all samples; τ is the torque of the given motion, A y the torque added by the
# change. A servo at its limit then starts early and arrives late, instead of late only.

FORCE_ROUNDS = 400
"""Of the alternating directions; each is two banded multiplications and one banded solution."""
PENALTY = 2e-3
"""Of the alternating directions [rad²/(N m)²]: the square of the compliance of a joint of 20 N m/rad."""
ENOUGH = 1e-5
"""A change that alters less from round to round is found [rad]: a hundredth of the 1.5e-3 of an encoder's tick."""


def torque_limited_reference(torque: Floats, bound: float, inertia: float, damping: float, dt: float) -> Floats:
    """The change (N,) [rad] of a joint's motion that keeps its torque (N,) [N m] within ± `bound`, at best; 0 at both ends.

    Args:
        inertia: J, inertia at the joint [kg m²].
        damping: d [N m s/rad].
        dt: from sample to sample [s].
    """
    count = len(torque)
    if count < 5 or np.abs(torque).max() <= bound:
        return np.zeros(count)
    mass, drag = inertia / dt**2, damping / (2 * dt)
    before, here, after = mass - drag, -2 * mass, mass + drag

    def add(change: Floats) -> Floats:
        padded = np.pad(change, 1)
        return before * padded[:-2] + here * change + after * padded[2:]

    def back(force: Floats) -> Floats:
        padded = np.pad(force, 1)
        return before * padded[2:] + here * force + after * padded[:-2]

    factor = (cholesky_banded(_normal(before, here, after, count), lower=True), True)
    least, most = -bound - torque, bound - torque
    change, dual = np.zeros(count), np.zeros(count)
    allowed = np.clip(0.0, least, most)
    for _ in range(FORCE_ROUNDS):
        last = change
        change = cho_solve_banded(factor, PENALTY * back(allowed - dual))
        added = 1.6 * add(change) - 0.6 * allowed
        allowed = np.clip(added + dual, least, most)
        dual += added - allowed
        if np.abs(change - last).max() < ENOUGH:
            break
    return change


def _normal(before: float, here: float, after: float, count: int) -> Floats:
    """I + ρ AᵀA as lower bands, the corners as in the middle: both ends are at rest anyway."""
    bands = np.zeros((3, count))
    bands[0] = 1 + PENALTY * (before**2 + here**2 + after**2)
    bands[1] = PENALTY * (before * here + here * after)
    bands[2] = PENALTY * before * after
    return bands


# Grasp: the forces by which a robot holds free bodies.
#
# A free body needs the wrench w = M a − g of its path. What touches it pushes it by forces within friction pyramids:
#
#     minimise  ‖Σ J_cᵀ f_c − w‖² + β² Σ_l (Σ_{c ∈ l} f_c − P)² + ε² ‖f‖²,    f within the pyramids,
#
# with a squeeze P of every link l of the robot. It is an internal force where links press against each other through the body, and vanishes
# where a single link touches. The pyramids are narrower than those of the contacts by `GRIP`.

GRIP = 0.5
"""Share of the friction that a grasp counts on [-]."""
SQUEEZE = 0.05
"""P over the weight of the robot [-]: position servos yield to it by millimetres, as much as they err, and weak arms are not bent by it.
The box sample with a free box takes the OP3 27.2 J with half and 33.0 J with double (28.3), and the box is as near to its path."""
TOUCH = RESTING
"""Surfaces of a plan this near to each other touch [m]."""
SLIDING = 0.02
"""A contact whose surfaces slide faster in the plan holds nothing: a hand on its way to its place [m/s]. With half, the free box of the box
sample on the OP3 is 29 instead of 8 mm off its path; with double as far as with this."""
PRESSED = 0.05
"""β, weight of the squeeze against the residual wrench of a body [-]."""
FORCE_RISE = 0.06
"""Standard deviation of the time in which forces rise and fall [s]."""


def grasp_pushes(plant: Plant, states: Floats, velocities: Floats, accelerations: Floats, rate: float) -> Floats:
    """Return (N, nv) generalised forces of the contacts that hold the free bodies; 0 without any.

    Args:
        plant: the robot among bodies.
        states: (N, nq) configurations of its model.
        velocities: (N, nv).
        accelerations: (N, nv).
        rate: states per second [1/s].
    """
    pushes = np.zeros(velocities.shape)
    if plant.bodies is None or not plant.bodies.free:
        return pushes
    grasp = _Grasp(plant, plant.bodies)
    for k, state in enumerate(zip(states, velocities, accelerations, strict=True)):
        pushes[k] = grasp.push(*state)
    return gaussian_filter1d(pushes, FORCE_RISE * rate, axis=0, mode="nearest")


class _Grasp:
    """Free bodies of a plant, and what touches them."""

    def __init__(self, plant: Plant, bodies: SimulatedBodies):
        self.model = copy.copy(plant.model)
        self._loose = copy.copy(plant.model)
        self._loose.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        self._geoms = np.flatnonzero(np.isin(self.model.geom_bodyid, bodies.ids[list(bodies.free)]))
        self.model.geom_margin[self._geoms] = TOUCH
        self._dofs = bodies.dofs
        self._links = plant.robot.model.nbody
        self._squeeze = SQUEEZE * plant.robot.gravity * float(plant.robot.model.body_mass.sum())

    def push(self, qpos: Floats, qvel: Floats, qacc: Floats) -> Floats:
        """Return (nv,) generalised force of the contacts in a state."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(self._loose, data)
        need = data.qfrc_inverse[self._dofs].copy()
        mujoco.mj_collision(self.model, data)
        touching = [self._pyramid(c, qvel) for c in data.contact if np.isin(c.geom, self._geoms).any()]
        holding = [(link, pyramid) for link, pyramid, speed in touching if speed < SLIDING]
        if not holding:
            return np.zeros(self.model.nv)
        generators = np.hstack([pyramid for _, pyramid in holding])
        links = np.repeat([link for link, _ in holding], 4)
        own = np.unique(links[links > 0])
        squeeze, ridge = PRESSED * (links == own[:, None]), EVENNESS * np.eye(len(links))
        wanted = np.concatenate([need, np.full(len(own), PRESSED * self._squeeze), np.zeros(len(links))])
        share, _ = nnls(np.vstack([generators[self._dofs], squeeze, ridge]), wanted)
        return generators @ share

    def _link(self, contact: mujoco.MjContact) -> int:
        """Return the link of the robot in a contact; 0 without."""
        bodies = self.model.geom_bodyid[contact.geom]
        return int(bodies.min()) if bodies.min() < self._links else 0

    def _pyramid(self, contact: mujoco.MjContact, qvel: Floats) -> tuple[int, Floats, float]:
        """Return the link of a contact, (nv, 4) generalised forces of the edges of its friction pyramid, and how fast it slides [m/s]."""
        normal, *tangents = contact.frame.reshape(3, 3)
        grip = GRIP * contact.friction[0]
        edges = np.array([normal + sign * grip * way for way in tangents for sign in (-1, 1)])
        slope, both = np.empty((3, self.model.nv)), np.zeros((3, self.model.nv))
        for sign, geom in zip((-1, 1), contact.geom, strict=True):
            mujoco.mj_jac(self.model, self.data, slope, None, contact.pos, int(self.model.geom_bodyid[geom]))
            both += sign * slope
        speed = float(np.linalg.norm(np.array(tangents) @ both @ qvel))
        return self._link(contact), both.T @ edges.T, speed


SMOOTHING = 0.02
"""Inverse dynamics uses accelerations averaged over a window of this standard deviation [s]: an XM430 follows 57 ms late, and no faster ones."""
SLOW = 0.05
"""Dry friction reverses within ± this speed [rad/s]: two units of 0.024 rad/s, in which an XM430 states its speed (data sheet)."""
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
    qvel = velocities(model, states, rate)
    qvel[[0, -1]] = 0
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
    root, coupling, ground = plant.root_dofs, Coupling(plant.robot), plant.ground
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
        torque[k] = _on_driven(plant, coupling, configurations[k], force[places.dofs])[plant.robot.dof_index]
    return torque, qvel[:, plant.dofs]


def _on_driven(plant: Plant, coupling: Coupling, qpos: Floats, force: Floats) -> Floats:
    """Return forces (nv,) with the same effect as others and, at best, none on hinges without a servo, at a configuration (nq,).

    Such hinges hang on others by gears and closed chains: their load goes to those. With J the Jacobian of the coupling,
    forces τ + Jᵀλ have the same effect; λ makes the forces of the loose hinges zero.
    """
    if not coupling.present:
        return force
    loose, (_, slope) = np.setdiff1d(plant.robot.dof_index, plant.robot.dof_index[plant.driven]), coupling(qpos)
    pull, *_ = np.linalg.lstsq(slope[:, loose].T, -force[loose], rcond=1e-6)
    return force + slope.T @ pull


def _ahead(goals: Floats, rate: float, delay: float) -> Floats:
    """Send goals (N, n) early by the delay and half a hold; both ends are unchanged."""
    at = np.arange(len(goals)) + (delay * rate + 0.5)
    sent = np.stack([np.interp(at, np.arange(len(goals)), column) for column in goals.T], axis=1)
    sent[0] = goals[0]
    return sent
