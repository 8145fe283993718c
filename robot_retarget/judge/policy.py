"""A frozen controller as the plant's control law: its observations, its actions, and the loop with a robot.

    goal = default + scale * action,     action = policy(observation),     torque = k_p (goal - q) - k_d omega

A contract states joints, gains and observations; `policy_files` reads it.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.inertial import tilt_of, vertical_in
from robot_retarget.base.arrays import Floats, bearing
from robot_retarget.base.errors import UsageError, known
from robot_retarget.judge.plant import Plant
from robot_retarget.robot.timing import sample
from robot_retarget.trajectory import Trajectory

STANDING_SPEED = 0.01
"""A reference slower than this stands: holosoma's walkers then get one phase for both feet [m/s, rad/s]."""


@dataclass(frozen=True)
class Term:
    """A part of the observation."""

    name: str
    scale: float | tuple[float, ...] = 1.0
    """Of the value, or of each of its numbers."""
    history: int = 1
    """Number of its latest values, the oldest first; before the first they repeat it."""


@dataclass(frozen=True)
class Contract:
    """Observations and actions of a policy."""

    rate: float
    """Actions a second [1/s]."""
    joints: tuple[str, ...]
    """(m,) in the order of the actions."""
    default: Floats
    """(m,) angles that an action of 0 means [rad]."""
    scale: Floats
    """(m,) angle per action [rad]."""
    stiffness: Floats
    """(m,) k_p [N m/rad]."""
    damping: Floats
    """(m,) k_d [N m s/rad]."""
    observation: tuple[Term, ...]
    period: float = 1.0
    """Of the gait, for the terms `sin_phase` and `cos_phase` [s]."""
    earlier: int = 0
    """Number of earlier observations that follow the present one, zeros before the first ..."""
    newest_first: bool = False
    """... and whether the latest of them comes first."""
    after: tuple[Term, ...] = ()
    """Terms that follow them."""
    clip: float = np.inf
    """Largest action that moves a goal [-]."""

    @property
    def follows_joints(self) -> bool:
        """Whether it observes the joints of the reference; a walker observes the way of its root alone."""
        return any(term.name == "reference_joints" for term in (*self.observation, *self.after))

    def __post_init__(self) -> None:
        for name in ("default", "scale", "stiffness", "damping"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape not in ((), (len(self.joints),)) or not np.isfinite(value).all():
                raise UsageError(f"policy: {name} has the shape {value.shape}, there are {len(self.joints)} joints")
            object.__setattr__(self, name, np.broadcast_to(value, len(self.joints)))
        for term in (*self.observation, *self.after):
            if term.name not in TERMS:
                raise UsageError(f"policy: no observation {term.name!r}; {known(TERMS, 20, typed=term.name)}")


@dataclass(frozen=True, eq=False)
class Policy:
    """A controller with its contract."""

    contract: Contract
    act: Callable[[Floats], Floats]
    """Maps an observation (w,) to an action (m,)."""
    width: int | None = None
    """Of its observation, where the controller states it."""
    name: str = "policy"


class PolicyLoop:
    """Gives the goals of each row from the state, as the feedback law does.

    Raises:
        UsageError: the policy has another rate than the goals, a joint that the robot lacks, or another width.
    """

    def __init__(self, plant: Plant, goals: Goals, trajectory: Trajectory) -> None:
        policy, robot = plant.policy, plant.robot
        self._contract, self._act = policy.contract, policy.act
        strange = [joint for joint in policy.contract.joints if joint not in robot.joint_names]
        if strange:
            raise UsageError(f"{policy.name} drives {strange[0]!r}; {known(robot.joint_names, 40, typed=strange[0])}")
        self.places = np.array([robot.joint_names.index(joint) for joint in policy.contract.joints])
        self._goals, self._plant, self._period = goals.angles, plant, policy.contract.period
        self._times, self._dt = goals.times, 1 / goals.rate
        self._root = sample(trajectory, robot, goals.times)[:, robot.root_address :][:, :7]
        self.last: Floats = np.zeros(len(self.places))
        self.before_last: Floats = self.last
        self._present, self._after = (
            [(term, deque[Floats](maxlen=term.history)) for term in terms]
            for terms in (policy.contract.observation, policy.contract.after)
        )
        self._earlier = deque[Floats](maxlen=policy.contract.earlier)
        self._width = policy.width

    def goal(self, row: int, data: mujoco.MjData) -> Floats:
        """Return the goals (n,) [rad] of a row; joints that the policy does not drive keep the reference."""
        observation = self._observed(row, data)
        if self._width not in (None, observation.size):
            every = (*self._present, *self._after)
            sizes = ", ".join(f"{term.name} {term.history * past[0].size}" for term, past in every)
            times = f", the first ones {1 + self._contract.earlier} times" if self._contract.earlier else ""
            raise UsageError(
                f"the policy observes {self._width} numbers, its contract gives {observation.size}: {sizes}{times}"
            )
        self.before_last, self.last = self.last, self._act(observation)
        if self.last.shape != self.places.shape:
            raise UsageError(f"the policy gives {self.last.size} actions, its contract has {self.places.size} joints")
        goal = np.array(self._goals[row])
        goal[self.places] = self._contract.default + self._contract.scale * self.last.clip(
            -self._contract.clip, self._contract.clip
        )
        return goal

    def _observed(self, row: int, data: mujoco.MjData) -> Floats:
        """Return the observation (w,): its terms, the earlier observations, and the terms after them."""
        contract = self._contract
        present = self._values(self._present, row, data)
        earlier = [np.zeros_like(present)] * (contract.earlier - len(self._earlier)) + [*self._earlier]
        observation = [present, *(earlier[::-1] if contract.newest_first else earlier)]
        self._earlier.append(present)
        return np.concatenate([*observation, self._values(self._after, row, data)])

    def _values(self, terms: Sequence[tuple[Term, deque[Floats]]], row: int, data: mujoco.MjData) -> Floats:
        parts: list[Floats] = []
        for term, past in terms:
            value = np.asarray(term.scale) * TERMS[term.name](self, row, data)
            past.extend([value] * (1 if past else term.history))
            parts += past
        return np.concatenate(parts) if parts else np.zeros(0)

    # What terms read

    def turn(self, data: mujoco.MjData) -> Floats:
        """(3, 3) rotation of the root body."""
        return _matrix(data.qpos[self._plant.places.qpos[self._plant.robot.root_address :][:7]][3:])

    def speed(self, data: mujoco.MjData) -> Floats:
        """(6,) of the root: linear in the world's axes, angular in the body's."""
        return data.qvel[self._plant.root_dofs]

    def angles(self, data: mujoco.MjData) -> Floats:
        return data.qpos[self._plant.hinges[self.places]] - self._contract.default

    def speeds(self, data: mujoco.MjData) -> Floats:
        return data.qvel[self._plant.dofs[self.places]]

    def reference(self, row: int) -> Floats:
        return self._goals[row, self.places]

    def reference_speeds(self, row: int) -> Floats:
        return (self.reference(min(row + 1, len(self._goals) - 1)) - self.reference(row)) / self._dt

    def place(self, row: int, data: mujoco.MjData) -> Floats:
        """(3,) of the reference's root in the axes of the robot's."""
        here = data.qpos[self._plant.places.qpos[self._plant.robot.root_address :][:3]]
        return self.turn(data).T @ (self._root[row, :3] - here)

    def relative_turn(self, row: int, data: mujoco.MjData) -> Floats:
        """(6,) first two columns of the rotation from the robot's root to the reference's, row by row."""
        return (self.turn(data).T @ _matrix(self._root[row, 3:]))[:, :2].ravel()

    @cached_property
    def motions(self) -> Floats:
        """(N, 6) velocity of the reference's root ahead and to the left in its axes [m/s], its height [m], roll and pitch [rad], and
        turning speed about its vertical axis [rad/s].
        """
        turns = Rotation.from_quat(self._root[:, 3:], scalar_first=True)
        change = np.zeros((len(turns), 3))
        change[:-1] = (turns[:-1].inv() * turns[1:]).as_rotvec()
        velocity = turns.inv().apply(np.diff(self._root[:, :3], axis=0, append=self._root[-1:, :3])) / self._dt
        return np.column_stack(
            [velocity[:, :2], self._root[:, 2], tilt_of(vertical_in(self._root[:, 3:])), change[:, 2] / self._dt]
        )

    @cached_property
    def commands(self) -> Floats:
        """(N, 3) velocity ahead and to the left [m/s] and turning speed [rad/s] of the reference's root, at its heading."""
        heading = np.unwrap(bearing(Rotation.from_quat(self._root[:, 3:], scalar_first=True).as_matrix()[:, :2, 0]))
        vx, vy = np.gradient(self._root[:, :2], self._dt, axis=0).T
        c, s = np.cos(heading), np.sin(heading)
        return np.stack([c * vx + s * vy, c * vy - s * vx, np.gradient(heading, self._dt)], axis=1)

    def phase(self, row: int) -> Floats:
        """(2,) of both feet, half a period apart; equal while the reference stands [rad]."""
        if np.linalg.norm(self.commands[row]) < STANDING_SPEED:
            return np.full(2, np.pi)
        return 2 * np.pi * self._times[row] / self._period + np.array([0.0, np.pi])


TERMS: dict[str, Callable[[PolicyLoop, int, mujoco.MjData], Floats]] = {
    "joints": lambda loop, row, data: loop.angles(data),
    "speeds": lambda loop, row, data: loop.speeds(data),
    "actions": lambda loop, row, data: loop.last,
    "gyro": lambda loop, row, data: loop.speed(data)[3:],
    "velocity": lambda loop, row, data: loop.turn(data).T @ loop.speed(data)[:3],
    "gravity": lambda loop, row, data: -loop.turn(data)[2],
    "up": lambda loop, row, data: loop.turn(data)[:, 2],
    "lean": lambda loop, row, data: tilt_of(loop.turn(data)[2]),
    "actions_before": lambda loop, row, data: loop.before_last,
    "command_velocity": lambda loop, row, data: loop.commands[row, :2],
    "command_turn": lambda loop, row, data: loop.commands[row, 2:],
    "sin_phase": lambda loop, row, data: np.sin(loop.phase(row)),
    "cos_phase": lambda loop, row, data: np.cos(loop.phase(row)),
    "reference_joints": lambda loop, row, data: loop.reference(row),
    "reference_speeds": lambda loop, row, data: loop.reference_speeds(row),
    "reference_place": lambda loop, row, data: loop.place(row, data),
    "reference_motion": lambda loop, row, data: loop.motions[row],
    "reference_turn": lambda loop, row, data: loop.relative_turn(row, data),
}
"""Terms of an observation: joints (m,) minus the default [rad], their speeds, the last action; angular velocity, velocity and the
direction of gravity in the root body's axes, its vertical axis in the world, roll and pitch [rad]; and the reference."""


def under_policy(plant: Plant, policy: Policy) -> Plant:
    """Return the plant with the policy's gains on its joints, in place of the stiffness and damping of their servos."""
    model, contract = plant.model, policy.contract
    if contract.damping.any():
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # Euler leaves a servo's damping explicit
    for joint, stiffness, damping in zip(contract.joints, contract.stiffness, contract.damping, strict=True):
        servo = plant.servos[plant.robot.joint_names.index(joint)] if joint in plant.robot.joint_names else -1
        if servo >= 0:
            if damping > 0 and not model.actuator_biasprm[servo, 2]:  # its damping is that of its joint
                model.dof_damping[plant.dofs[plant.robot.joint_names.index(joint)]] = 0.0
            model.actuator_gear[servo, 0] = 1.0
            model.actuator_gainprm[servo, 0] = stiffness
            model.actuator_biasprm[servo, :3] = 0.0, -stiffness, -damping
    return replace(plant, policy=policy)


def _matrix(quaternion: Sequence[float] | Floats) -> Floats:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, dtype=float))
    return matrix.reshape(3, 3)
