"""Step the physics: the plant's servos follow a trajectory, and every state is recorded."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.judge.feedback import ClosedLoop, closed_loop
from robot_retarget.judge.goals import Playback, plain_goals
from robot_retarget.judge.plant import Mode, Plant
from robot_retarget.judge.played import PlayedPlant
from robot_retarget.robot.contacts import ContactLog, Contacts
from robot_retarget.robot.timing import sample
from robot_retarget.trajectory import Trajectory

SPEED_LIMIT = 1e3
"""The integration has failed if a coordinate is faster than this [m/s, rad/s]."""


@dataclass(frozen=True, eq=False)
class Rollout:
    """The state after each goal, N in all; time 0 is where the trajectory begins, the settling before it is negative.

    Forces and contacts are those of the last step, that led to the state.
    """

    times: Floats
    """(N,) [s]."""
    qpos: Floats
    """(N, nq) of the robot; a joint's angle includes the play of its gears."""
    hinges: Floats
    """(N, n) measured by the encoders [rad]: without the play."""
    speeds: Floats
    """(N, n) [rad/s]."""
    torque: Floats
    """(N, n) of the actuators [N m], before the back-EMF is subtracted."""
    com: Floats
    """(N, 3) centre of mass [m]."""
    ground: Floats
    """(N, 6) force [N] and torque about the world's origin [N m] that the ground exerts on a robot with a free root."""
    contacts: Contacts
    """Contacts of the robot with itself and the floor; their frames are the N states."""
    around: Contacts
    """Contacts of its links with bodies of the scene, by their ids in the plant's model."""
    unstable: float | None
    """When the simulation broke down [s], or None."""
    steps_per_second: float
    """Of physics."""
    added: Floats | None = None
    """(N, n) correction of the goals by the feedback [rad]; None without feedback."""
    bodies: dict[str, Any] = field(default_factory=dict)
    """Figures of free bodies of the scene."""
    stopped: float | None = None
    """When the feedback gave up on a lean and let the robot crouch [s], or None."""


def roll_out(
    plant: Plant,
    trajectory: Trajectory,
    mode: Mode,
    playback: Playback | None = None,
    command: Goals | None = None,
) -> Rollout:
    """Step the physics from settling to the end.

    Args:
        playback: its delay counts, and where no goals are given its rate and settling.
        command: goals (`compensate.compensated`); by default the trajectory itself. Its feedback acts in
            mode `free`.
    """
    playback, plant = playback or Playback(), plant.with_own_model()
    goals, free = command or plain_goals(plant, trajectory, playback), mode == "free"
    played, times = PlayedPlant(plant, goals.rate, playback.delay), goals.times
    played.place(trajectory.qpos[0], on_floor=free)
    carried = None if free else sample(trajectory, plant.robot, times)
    loop = closed_loop(plant, goals, playback.seed) if free else None
    paths = None if plant.bodies is None else plant.bodies.paths(times * trajectory.fps)
    log, began = _Log(plant, len(times)), time.perf_counter()
    with _quiet():
        done = _ticks(played, goals, log, loop, carried, paths)
    pace = played.held * done / (time.perf_counter() - began)
    unstable = None if done == len(times) else float(times[done])
    rollout = log.rollout(times[:done] + played.seconds, unstable, pace)
    if plant.bodies is not None and paths is not None:
        rollout = replace(rollout, bodies=plant.bodies.figures(paths, log.bodies[:done], times[:done]))
    if loop is None:
        return rollout
    stopped = None if loop.stopped is None else float(times[loop.stopped])
    return replace(rollout, added=loop.added[:done], stopped=stopped)


def _ticks(
    played: PlayedPlant,
    goals: Goals,
    log: "_Log",
    loop: ClosedLoop | None,
    carried: Floats | None,
    paths: Floats | None,
) -> int:
    """Play N goals and record the states; return how many it came through before it broke down.

    Args:
        loop: corrects the goals.
        carried: (N, nq) configurations to whose root the robot is fixed.
        paths: (N, B, 7) poses of the bodies of the scene.
    """
    data, bodies = played.data, played.plant.bodies
    for k, (goal, moment) in enumerate(zip(goals.angles, goals.times, strict=True)):
        if carried is not None:
            played.carry(carried[k])
        if paths is not None and bodies is not None:
            bodies.place(data, paths[k], settling=bool(moment < 0))
        played.tick(goal if loop is None else loop.goal(k, data))
        if not np.abs(data.qvel).max() < SPEED_LIMIT:  # so written, NaN stops here too
            return k
        log.note(k, data)
    return len(goals)


class _Log:
    """Records the states of a simulation."""

    def __init__(self, plant: Plant, count: int):
        self.plant = plant
        model, robot = plant.model, plant.robot
        self.contacts = ContactLog(model, robot.model.nbody)
        self.qpos, self.qvel = np.empty((count, model.nq)), np.empty((count, model.nv))
        self.torque, self.wrench = np.empty((count, model.nv)), np.zeros((count, 6))
        self._bodies = plant.bodies.ids if plant.bodies else np.zeros(0, np.int64)
        self.bodies = np.empty((count, len(self._bodies), 3))
        self.com, self.place, self.turn = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 9))
        self._body = robot.root_body
        self._root = plant.root_dofs if robot.floating else None

    def note(self, k: int, data: mujoco.MjData) -> None:
        self.qpos[k], self.qvel[k], self.torque[k] = data.qpos, data.qvel, data.qfrc_actuator
        self.com[k] = data.subtree_com[self._body]
        self.bodies[k] = data.xpos[self._bodies]
        self.place[k], self.turn[k] = data.xpos[self._body], data.xmat[self._body]
        if self._root is not None:
            self.wrench[k] = data.qfrc_constraint[self._root]
        self.contacts.record(k, data)

    def rollout(self, times: Floats, unstable: float | None, pace: float) -> Rollout:
        """Return the recorded states at times (N,) [s] as a rollout; a simulation that broke down has fewer."""
        n, plant, dofs = len(times), self.plant, self.plant.dofs
        qpos = plant.places.configuration(self.qpos[:n])
        return Rollout(
            times, qpos, self.qpos[:n, plant.hinges], self.qvel[:n, dofs], self.torque[:n, dofs], self.com[:n], self._ground(n),
            self.contacts.table(), self.contacts.around(), unstable, pace,
        )  # fmt: skip

    def _ground(self, n: int) -> Floats:
        """The root's share of the constraint forces is the ground's wrench: contacts of the robot with itself cancel.

        MuJoCo has the torque about the root body's origin, in the body's axes.
        """
        force = self.wrench[:n, :3]
        torque = np.einsum("nij,nj->ni", self.turn[:n].reshape(-1, 3, 3), self.wrench[:n, 3:])
        return np.concatenate([force, torque + np.cross(self.place[:n], force)], axis=1)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress MuJoCo's warnings, which it writes to a file in the working folder; the step loop detects instability itself."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
