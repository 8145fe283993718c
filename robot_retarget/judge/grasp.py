"""Grasp: the forces by which a robot holds free bodies.

A free body needs the wrench w = M a − g of its path. What touches it pushes it by forces within friction pyramids:

    minimise  ‖Σ J_cᵀ f_c − w‖² + β² Σ_l (Σ_{c ∈ l} f_c − P)² + ε² ‖f‖²,    f within the pyramids,

with a squeeze P of every link l of the robot. It is an internal force where links press against each other through the body, and vanishes
where a single link touches. The pyramids are narrower than those of the contacts by `GRIP`.
"""

import copy

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import nnls

from robot_retarget.base.arrays import Floats
from robot_retarget.judge.bodies import SimulatedBodies
from robot_retarget.judge.plant import Plant

GRIP = 0.5
"""Share of the friction that a grasp counts on [-]."""
SQUEEZE = 0.05
"""P over the weight of the robot [-]: position servos yield to it by millimetres, as much as they err, and weak arms are not bent by it."""
TOUCH = 0.003
"""Surfaces of a plan this near to each other touch [m]."""
SLIDING = 0.02
"""A contact whose surfaces slide faster in the plan holds nothing: a hand on its way to its place [m/s]."""
PRESSED = 0.05
"""β, weight of the squeeze against the residual wrench of a body [-]."""
EVENNESS = 1e-3
"""ε, weight of contact forces [N] against the residual wrench of a body [N, N m]."""
RISE = 0.06
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
    return gaussian_filter1d(pushes, RISE * rate, axis=0, mode="nearest")


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
