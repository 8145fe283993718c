"""One tick of simulation: a goal comes to the servos of a plant, late by a delay, and is held till the next."""

import copy
from collections import deque

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.judge.plant import Plant
from robot_retarget.scene.geoms import scene_geoms


class PlayedPlant:
    """A plant on which goals are played.

    Args:
        plant: the physics.
        rate: of the goals [1/s]; each is held for a whole number of steps.
        delay: from the host to the windings [s], rounded to steps.
    """

    def __init__(self, plant: Plant, rate: float, delay: float = 0.0) -> None:
        step = plant.model.opt.timestep
        self.plant, self.data = plant, mujoco.MjData(plant.model)
        self.held, self.late = max(1, round(1 / (rate * step))), round(delay / step)
        self.seconds = self.held * step
        """Time that a goal is held for [s]."""
        self.sent = deque[Floats](maxlen=self.late // self.held + 2)
        """Controls that are on their way or held, the latest last."""

    def copy(self) -> "PlayedPlant":
        """Return an independent copy of the state, on the same plant."""
        other = copy.copy(self)
        other.data, other.sent = copy.copy(self.data), self.sent.copy()
        return other

    def place(self, qpos: Floats, on_floor: bool) -> None:
        """Set the robot to a configuration (nq,), its lowest geom on the floor if desired."""
        self.data.qpos[:] = self.plant.places.model_qpos(qpos)
        if on_floor:
            _set_on_floor(self.plant.model, self.data)

    def carry(self, qpos: Floats) -> None:
        """Set the root to its place in a configuration (nq,), at rest."""
        plant, roots = self.plant, self.plant.root_coordinates
        self.data.qpos[plant.places.qpos[roots]], self.data.qvel[plant.root_dofs] = qpos[roots], 0.0

    def tick(self, goal: Floats) -> None:
        """Send goals (n,) [rad] and step the physics till the next ones."""
        self.sent.append(self.plant.controls(goal[None])[0])
        whole, rest = divmod(self.late, self.held)
        if rest:
            self._step(whole + 1, rest)
        self._step(whole, self.held - rest)

    def _step(self, back: int, count: int) -> None:
        """Step under the controls sent a number of goals ago, or under the first ones."""
        self.data.ctrl[:] = self.sent[max(len(self.sent) - back - 1, 0)]
        self.plant.step(self.data, count)


def _set_on_floor(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Move the root vertically until the lowest geom touches the solid scene."""
    mujoco.mj_forward(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    bodies = np.isin(np.arange(model.ngeom), scene_geoms(model))
    ground = (model.geom_bodyid == 0) | (bodies & (model.body_weldid[model.geom_bodyid] == 0))
    scene = np.flatnonzero(solid & ground & (model.geom_type != mujoco.mjtGeom.mjGEOM_HFIELD)).tolist()
    own = np.flatnonzero(solid & ~ground & ~bodies).tolist()
    far, ends = 100.0, np.zeros(6)
    gaps = [mujoco.mj_geomDistance(model, data, a, b, far, ends) for a in scene for b in own]
    gap = min(gaps, default=far)
    if gap < far:
        root = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]
        data.qpos[model.jnt_qposadr[root] + 2] -= gap
