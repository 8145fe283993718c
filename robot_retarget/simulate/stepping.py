"""Step the physics: the plant's servos follow a trajectory, everything is written down."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.robot.timing import sample
from robot_retarget.simulate.contacts import ContactLog, Contacts
from robot_retarget.simulate.plant import Mode, Plant, root_coordinates, root_dofs
from robot_retarget.trajectory import Trajectory

SETTLE = 1.0
"""The first pose is held this long before the trajectory begins [s]."""
SPEED_LIMIT = 1e3
"""A coordinate faster than this [m/s, rad/s] is the integration failing, no motion of a robot."""


@dataclass(frozen=True, eq=False)
class Rollout:
    """N simulation steps; time 0 is where the trajectory begins, the settling before it is negative."""

    times: Floats
    """(N,) [s]."""
    hinges: Floats
    """(N, n) measured [rad]."""
    torque: Floats
    """(N, n) of the servos [N m]."""
    contacts: Contacts
    """All contacts; their frames are steps."""
    unstable: float | None
    """When the simulation broke down [s], or None."""
    steps_per_second: float


def roll_out(plant: Plant, trajectory: Trajectory, mode: Mode) -> Rollout:
    """Step the physics from settling to the last frame, the controls straight between frames."""
    model, step = plant.model, plant.model.opt.timestep
    times = np.arange(-round(SETTLE / step), round(trajectory.duration / step) + 1) * step
    wanted = sample(trajectory, plant.robot, times)
    data = mujoco.MjData(model)
    data.qpos[:] = wanted[0]
    if mode == "free":
        _set_on_floor(model, data)
    held = (root_coordinates(plant.robot), root_dofs(plant.robot)) if mode == "pinned" else None
    began = time.perf_counter()
    with _quiet():
        qpos, torque, contacts = _steps(model, data, wanted, plant.controls(wanted), held)
    pace = len(qpos) / (time.perf_counter() - began)
    unstable = None if len(qpos) == len(times) else float(times[len(qpos)])
    index, dofs = plant.robot.qpos_index, plant.robot.dof_index
    return Rollout(times[: len(qpos)], qpos[:, index], torque[:, dofs], contacts, unstable, pace)


def _steps(
    model: mujoco.MjModel, data: mujoco.MjData, wanted: Floats, controls: Floats, held: tuple[Ints, Ints] | None
) -> tuple[Floats, Floats, Contacts]:
    """The plain loop: qpos (N, nq), actuator torque (N, nv) and contacts at each step, cut where it breaks down."""
    qpos, torque = np.empty((len(wanted), model.nq)), np.empty((len(wanted), model.nv))
    log = ContactLog(model)
    for k, control in enumerate(controls):
        data.ctrl[:] = control
        if held is not None:
            data.qpos[held[0]], data.qvel[held[1]] = wanted[k, held[0]], 0.0
        qpos[k] = data.qpos
        mujoco.mj_step(model, data)
        if not np.abs(data.qvel).max() < SPEED_LIMIT:  # so written, NaN stops here too
            return qpos[:k], torque[:k], log.table()
        torque[k] = data.qfrc_actuator
        log.note(k, data)
    return qpos, torque, log.table()


def _set_on_floor(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Lift or lower the root until the lowest geom just touches what is solid in the scene."""
    mujoco.mj_forward(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    scene = np.flatnonzero(solid & (model.geom_bodyid == 0))
    own = np.flatnonzero(solid & (model.geom_bodyid != 0))
    far, ends = 100.0, np.zeros(6)
    gaps = [mujoco.mj_geomDistance(model, data, a, b, far, ends) for a in scene for b in own]
    gap = min(gaps, default=far)
    if gap < far:
        root = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]
        data.qpos[model.jnt_qposadr[root] + 2] -= gap


@contextmanager
def _quiet() -> Iterator[None]:
    """MuJoCo's warnings would go to a file in the working folder; what they warn of is found by the step loop."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
