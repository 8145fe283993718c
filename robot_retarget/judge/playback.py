"""Playback: goals as a player sends them, the physics that they come to, and the states that follow."""

import copy
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from robot_retarget.actuators.goals import RATE, Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.judge.feedback import ClosedLoop, closed_loop
from robot_retarget.judge.plant import Mode, Plant
from robot_retarget.judge.policy import PolicyLoop
from robot_retarget.robot.contacts import ContactLog, Contacts
from robot_retarget.robot.dynamics import root_dofs, velocities
from robot_retarget.robot.timing import sample, sample_hinges
from robot_retarget.scene.geoms import scene_geoms
from robot_retarget.solver.limits import within_speeds
from robot_retarget.trajectory import Trajectory

# Goals as a player sends them: rate, delay, settling, and the limits of the servo map.


@dataclass(frozen=True)
class Playback:
    """How goals come to the servos."""

    rate: float = RATE
    """Goals a second, each held till the next; rounded to whole steps of the physics."""
    delay: float = 0.002
    """From the host to the windings [s], rounded to whole steps of the physics: goals for 20 servos take 1.1 ms on a wire of
    1 Mbaud."""
    settle_before: float = 1.0
    """The first pose is held this long before the trajectory begins [s]."""
    settle_after: float = 1.0
    """The last pose is held this long after it ends [s]."""
    seed: int = 0
    """Of the inertial sensor's noise and bias."""

    def __post_init__(self) -> None:
        for name, low in (("rate", 1.0), ("delay", 0.0), ("settle_before", 0.0), ("settle_after", 0.0)):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= low):
                raise UsageError(f"{name} must be a number of at least {low:g}, got {value}")

    def steps(self, step: float) -> int:
        """Steps of the physics [s] that a goal is held for."""
        return max(1, round(1 / (self.rate * step)))

    def on(self, plant: Plant) -> float:
        """The rate at which goals come to a plant, whose steps are whole [1/s]."""
        step = plant.model.opt.timestep
        return 1 / (self.steps(step) * step)


def plain_goals(plant: Plant, trajectory: Trajectory, playback: Playback | None = None) -> Goals:
    """The trajectory itself, as far as the servo map lets it be."""
    playback = playback or Playback()
    rate = playback.on(plant)
    times = np.arange(round(trajectory.duration * rate) + 1) / rate
    return settled(plant, sample_hinges(trajectory, plant.robot, times), playback)


def settled(plant: Plant, angles: Floats, playback: Playback) -> Goals:
    """Angles (N, n) at the playback's rate with the settling before and after.

    With a servo map, the goals are moved to the nearest path within its ranges and its speed: a player with that map sends exactly
    the goals that are judged.
    """
    rate = playback.on(plant)
    before, after = (round(settle * rate) for settle in (playback.settle_before, playback.settle_after))
    padded = np.pad(angles, ((before, after), (0, 0)), mode="edge")
    servo_map = plant.servo_map
    if servo_map is not None:
        servos = [servo_map[joint] for joint in plant.robot.joint_names]
        low, high = np.array([servo.reach for servo in servos]).T
        reach = np.full(len(servos), servo_map.limits.speed / rate)
        padded = within_speeds(np.clip(padded, low, high), reach)
    judged_on = "" if servo_map is None else servo_map.fingerprint
    return Goals(padded, rate, before / rate, after / rate, judged_on)


# One tick of simulation: a goal comes to the servos of a plant, late by a delay, and is held till the next.


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

    def place(self, qpos: Floats, on_floor: bool, lower: bool = True) -> None:
        """Set the robot to a configuration (nq,), its lowest geom on the floor if desired.

        Args:
            lower: whether a robot above the floor is lowered to it.
        """
        self.data.qpos[:] = self.plant.places.model_qpos(qpos)
        if on_floor:
            _set_on_floor(self.plant.model, self.data, 100.0 if lower else 0.0)

    def push(self, velocity: Floats) -> None:
        """Set the velocity (nv,) of the robot."""
        plant, robot = self.plant, self.plant.robot
        self.data.qvel[plant.root_dofs], self.data.qvel[plant.dofs] = (
            velocity[root_dofs(robot)],
            velocity[robot.dof_index],
        )

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


def _set_on_floor(model: mujoco.MjModel, data: mujoco.MjData, far: float) -> None:
    """Move the root vertically until the lowest geom touches the solid scene, from less than a height above it [m]."""
    mujoco.mj_forward(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    bodies = np.isin(np.arange(model.ngeom), scene_geoms(model))
    ground = (model.geom_bodyid == 0) | (bodies & (model.body_weldid[model.geom_bodyid] == 0))
    scene = np.flatnonzero(solid & ground & (model.geom_type != mujoco.mjtGeom.mjGEOM_HFIELD)).tolist()
    own = np.flatnonzero(solid & ~ground & ~bodies).tolist()
    ends = np.zeros(6)
    gaps = [mujoco.mj_geomDistance(model, data, a, b, far, ends) for a in scene for b in own]
    gap = min(gaps, default=far)
    if gap < far:
        root = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]
        data.qpos[model.jnt_qposadr[root] + 2] -= gap


# Step the physics: the plant's servos follow a trajectory, and every state is recorded.

SPEED_LIMIT = 1e3
"""The integration has failed if a coordinate is faster than this [m/s, rad/s]: 25 times the 40 rad/s of the fastest servo in `servos.csv`."""


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
    plant: Plant, trajectory: Trajectory, mode: Mode, playback: Playback | None = None, command: Goals | None = None
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
    moves = plant.policy is not None and not goals.lead_in
    played.place(trajectory.qpos[0], on_floor=free, lower=not moves)
    if moves:
        played.push(velocities(plant.robot.model, trajectory.qpos[:2], trajectory.fps)[0])
    carried = None if free else sample(trajectory, plant.robot, times)
    loop = closed_loop(plant, goals, playback.seed) if free else None
    if plant.policy is not None:
        loop = PolicyLoop(plant, goals, trajectory)
    paths = None if plant.bodies is None else plant.bodies.paths(times * trajectory.fps)
    log, began = _Log(plant, len(times)), time.perf_counter()
    with _quiet():
        done = _ticks(played, goals, log, loop, carried, paths)
    pace = played.held * done / (time.perf_counter() - began)
    unstable = None if done == len(times) else float(times[done])
    rollout = log.rollout(times[:done] + played.seconds, unstable, pace)
    if plant.bodies is not None and paths is not None:
        rollout = replace(rollout, bodies=plant.bodies.figures(paths, log.bodies[:done], times[:done]))
    if not isinstance(loop, ClosedLoop):
        return rollout
    stopped = None if loop.stopped is None else float(times[loop.stopped])
    return replace(rollout, added=loop.added[:done], stopped=stopped)


def _ticks(
    played: PlayedPlant,
    goals: Goals,
    log: "_Log",
    loop: ClosedLoop | PolicyLoop | None,
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
