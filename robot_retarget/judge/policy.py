"""A frozen controller as the plant's control law: its observations, its actions, and the loop with a robot.

    goal = default + scale * action,     action = policy(observation),     torque = k_p (goal - q) - k_d omega

A contract states joints, gains and observations. It is read from `FILE.toml` beside `FILE.onnx`, or from the metadata of mjlab
(BeyondMimic) and of holosoma's walkers.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.judge.plant import Plant
from robot_retarget.robot.timing import sample
from robot_retarget.trajectory import Trajectory

STILL = 0.01
"""A reference slower than this stands: holosoma's walkers then get one phase for both feet [m/s, rad/s]."""


@dataclass(frozen=True)
class Term:
    """A part of the observation."""

    name: str
    scale: float = 1.0
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

    def __post_init__(self) -> None:
        for name in ("default", "scale", "stiffness", "damping"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape not in ((), (len(self.joints),)) or not np.isfinite(value).all():
                raise UsageError(f"policy: {name} has the shape {value.shape}, there are {len(self.joints)} joints")
            object.__setattr__(self, name, np.broadcast_to(value, len(self.joints)))
        for term in self.observation:
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


def read_policy(path: str | Path) -> Policy:
    """Read an ONNX policy and its contract.

    Raises:
        UsageError: onnxruntime is not installed, the file is no policy, or nothing states its contract.
    """
    try:
        import onnxruntime  # pyright: ignore[reportMissingImports]  (the extra `policy`)
    except ImportError:
        raise UsageError("--policy needs onnxruntime: pip install onnxruntime") from None
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no other base
        raise UsageError(f"{path} is no ONNX policy: {str(error).splitlines()[0]}") from error
    beside, metadata = Path(path).with_suffix(".toml"), session.get_modelmeta().custom_metadata_map
    if not beside.exists() and not ({"joint_names", "dof_names"} & metadata.keys()):
        raise UsageError(f"{path}: no metadata of mjlab or holosoma, and no contract {beside}")
    try:
        contract = contract_of(read_toml(beside, UsageError)) if beside.exists() else from_metadata(metadata)
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: its contract lacks or breaks {error}") from error
    first, *others = session.get_inputs()
    if others:
        raise UsageError(f"{path}: a policy takes one observation, this one also {', '.join(i.name for i in others)}")
    out, width = session.get_outputs()[0].name, first.shape[-1]

    def act(observation: Floats) -> Floats:
        return np.asarray(
            session.run([out], {first.name: observation[None].astype(np.float32)})[0], dtype=float
        ).ravel()

    return Policy(contract, act, width if isinstance(width, int) else None, Path(path).name)


def contract_of(table: Mapping[str, Any]) -> Contract:
    """Return the contract in a TOML table; `observation` lists names, or tables of `name`, `scale` and `history`."""
    terms = tuple(Term(term) if isinstance(term, str) else Term(**term) for term in table["observation"])
    return Contract(**{**table, "joints": tuple(table["joints"]), "observation": terms})


def from_metadata(metadata: Mapping[str, str]) -> Contract:
    """Return the contract in the metadata of mjlab's policies, or of holosoma's walkers on the G1 and the T1."""
    if "joint_names" in metadata:
        default, scale, stiffness, damping = (
            np.array([float(word) for word in metadata[key].split(",")])
            for key in ("default_joint_pos", "action_scale", "joint_stiffness", "joint_damping")
        )
        names = metadata["observation_names"].split(",")
        terms = tuple(Term(part) for name in names for part in MJLAB.get(name, (name,)))
        return Contract(50.0, tuple(metadata["joint_names"].split(",")), default, scale, stiffness, damping, terms)
    joints = tuple(json.loads(metadata["dof_names"]))
    stand, gyro, speeds = next((row for joint, row in HOLOSOMA.items() if joint in joints), ({}, 1.0, 1.0))
    if not stand:
        raise UsageError(
            f"policy: holosoma's walkers are known with {' or '.join(HOLOSOMA)} among their joints: write a contract"
        )
    terms = (
        Term("actions"), Term("gyro", gyro), Term("command_turn"), Term("command_velocity"), Term("cos_phase"),
        Term("joints"), Term("speeds", speeds), Term("gravity"), Term("sin_phase"),
    )  # fmt: skip
    default = np.array([next((angle for end, angle in stand.items() if joint.endswith(end)), 0.0) for joint in joints])
    stiffness, damping = (np.array(json.loads(metadata[key])) for key in ("kp", "kd"))
    return Contract(50.0, joints, default, np.array(0.25), stiffness, damping, terms)


MJLAB = {
    "command": ("reference_joints", "reference_speeds"),
    "motion_anchor_pos_b": ("reference_place",),
    "motion_anchor_ori_b": ("reference_turn",),
    "joint_pos": ("joints",),
    "joint_vel": ("speeds",),
    "base_ang_vel": ("gyro",),
    "base_lin_vel": ("velocity",),
    "projected_gravity": ("gravity",),
}
"""Terms of mjlab's tracking task by the names in its metadata; `actions` is one of ours."""
HOLOSOMA: dict[str, tuple[dict[str, float], float, float]] = {
    "left_hip_pitch_joint": (
        {
            "hip_pitch_joint": -0.312, "knee_joint": 0.669, "ankle_pitch_joint": -0.363, "elbow_joint": 0.6,
            "shoulder_pitch_joint": 0.2, "left_shoulder_roll_joint": 0.2, "right_shoulder_roll_joint": -0.2,
        }, 0.25, 0.05,
    ),
    "AAHead_yaw": (
        {
            "Shoulder_Pitch": 0.2, "Left_Shoulder_Roll": -1.35, "Right_Shoulder_Roll": 1.35, "Left_Elbow_Yaw": -0.5,
            "Right_Elbow_Yaw": 0.5, "Hip_Pitch": -0.2, "Knee_Pitch": 0.4, "Ankle_Pitch": -0.25,
        }, 1.0, 0.1,
    ),
}  # fmt: skip
"""By one of a robot's joints: its standing pose [rad], and the scales of gyroscope and speeds. From the configuration of holosoma at
fc600e7d: the metadata have joints and gains only, and the observation is in alphabetical order of its names."""


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
        self._past = [deque[Floats](maxlen=term.history) for term in policy.contract.observation]
        self.added: Floats = np.zeros_like(goals.angles)
        """(N, n) goals minus the reference [rad]."""
        self.stopped: int | None = None
        self._width = policy.width

    def goal(self, row: int, data: mujoco.MjData) -> Floats:
        """Return the goals (n,) [rad] of a row; joints that the policy does not drive keep the reference."""
        parts = []
        for term, past in zip(self._contract.observation, self._past, strict=True):
            value = term.scale * TERMS[term.name](self, row, data)
            past.extend([value] * (1 if past else term.history))
            parts += past
        observation = np.concatenate(parts)
        if self._width not in (None, observation.size):
            sizes = ", ".join(
                f"{t.name} {t.history * p[0].size}" for t, p in zip(self._contract.observation, self._past, strict=True)
            )
            raise UsageError(
                f"the policy observes {self._width} numbers, its contract gives {observation.size}: {sizes}"
            )
        self.last = self._act(observation)
        if self.last.shape != self.places.shape:
            raise UsageError(f"the policy gives {self.last.size} actions, its contract has {self.places.size} joints")
        goal = np.array(self._goals[row])
        goal[self.places] = self._contract.default + self._contract.scale * self.last
        self.added[row] = goal - self._goals[row]
        return goal

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
    def commands(self) -> Floats:
        """(N, 3) velocity ahead and to the left [m/s] and turning speed [rad/s] of the reference's root, at its heading."""
        turns = np.array([_matrix(quaternion) for quaternion in self._root[:, 3:]])
        heading = np.unwrap(np.arctan2(turns[:, 1, 0], turns[:, 0, 0]))
        vx, vy = np.gradient(self._root[:, :2], self._dt, axis=0).T
        c, s = np.cos(heading), np.sin(heading)
        return np.stack([c * vx + s * vy, c * vy - s * vx, np.gradient(heading, self._dt)], axis=1)

    def phase(self, row: int) -> Floats:
        """(2,) of both feet, half a period apart; equal while the reference stands [rad]."""
        if np.linalg.norm(self.commands[row]) < STILL:
            return np.full(2, np.pi)
        return 2 * np.pi * self._times[row] / self._period + np.array([0.0, np.pi])


TERMS: dict[str, Callable[[PolicyLoop, int, mujoco.MjData], Floats]] = {
    "joints": lambda loop, row, data: loop.angles(data),
    "speeds": lambda loop, row, data: loop.speeds(data),
    "actions": lambda loop, row, data: loop.last,
    "gyro": lambda loop, row, data: loop.speed(data)[3:],
    "velocity": lambda loop, row, data: loop.turn(data).T @ loop.speed(data)[:3],
    "gravity": lambda loop, row, data: -loop.turn(data)[2],
    "command_velocity": lambda loop, row, data: loop.commands[row, :2],
    "command_turn": lambda loop, row, data: loop.commands[row, 2:],
    "sin_phase": lambda loop, row, data: np.sin(loop.phase(row)),
    "cos_phase": lambda loop, row, data: np.cos(loop.phase(row)),
    "reference_joints": lambda loop, row, data: loop.reference(row),
    "reference_speeds": lambda loop, row, data: loop.reference_speeds(row),
    "reference_place": lambda loop, row, data: loop.place(row, data),
    "reference_turn": lambda loop, row, data: loop.relative_turn(row, data),
}
"""Terms of an observation: joints (m,) minus the default [rad], their speeds, the last action; angular velocity, velocity and the
direction of gravity in the root body's axes; and the reference."""


def under_policy(plant: Plant, policy: Policy) -> Plant:
    """Return the plant with the policy's gains on its joints."""
    model, contract = plant.model, policy.contract
    if contract.damping.any():
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # Euler leaves a servo's damping explicit
    for joint, stiffness, damping in zip(contract.joints, contract.stiffness, contract.damping, strict=True):
        servo = plant.servos[plant.robot.joint_names.index(joint)] if joint in plant.robot.joint_names else -1
        if servo >= 0:
            model.actuator_gear[servo, 0] = 1.0
            model.actuator_gainprm[servo, 0] = stiffness
            model.actuator_biasprm[servo, :3] = 0.0, -stiffness, -damping
    return replace(plant, policy=policy)


def _matrix(quaternion: Sequence[float] | Floats) -> Floats:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, dtype=float))
    return matrix.reshape(3, 3)
