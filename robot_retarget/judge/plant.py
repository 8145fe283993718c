"""The physics that a trajectory is played on: the robot's own model with a position servo on every driven hinge."""

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import mujoco
import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.judge.bodies import SimulatedBodies
from robot_retarget.judge.servo_model import Drives
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.model import Robot
from robot_retarget.robot.support import feet_of
from robot_retarget.scene.geoms import PREFIX, SolidGround

Mode = Literal["pinned", "free"]

CRISP = 0.004
"""Time constant of a sole's contact with the floor [s]; MuJoCo's default of 0.02 is a cushion."""
LEAST_SUPPLY = 9.5 / 12
"""Of the servos' nominal voltage [-]: an XM430 of 12 V shuts down below 9.5 V (e-Manual, Min Voltage Limit)."""
PLAY = "play of "
"""Names of the passive hinges begin with this."""


@dataclass(frozen=True, eq=False)
class Places:
    """Where a plant's model has the robot's coordinates: in the robot's order, with P play angles between them."""

    qpos: Ints
    """(nq,) indices of the robot's configuration in the model's."""
    dofs: Ints
    """(nv,) indices of the robot's velocities in the model's."""
    loose: Ints
    """(P,) indices of the hinges with play in the robot's configuration; P is 0 or n."""
    play: Ints
    """(P,) ids of the passive hinges in the model ..."""
    play_qpos: Ints
    """... and their indices in the model's configuration."""
    rest: Floats
    """The model's reference configuration: play in the middle, free bodies of a scene where they begin."""

    def model_qpos(self, qpos: Floats) -> Floats:
        """Return configurations (…, nq) of the robot as those of the model, with the play in the middle."""
        found = np.tile(self.rest, (*np.shape(qpos)[:-1], 1))
        found[..., self.qpos] = qpos
        return found

    def configuration(self, states: Floats) -> Floats:
        """Return configurations of the model as those of the robot (…, nq): the angle of a joint is that of its shaft plus its play."""
        found = states[..., self.qpos]
        found[..., self.loose] += states[..., self.play_qpos]
        return found


@dataclass(frozen=True)
class Supply:
    """A supply whose voltage falls under load: V = V₀ − R I."""

    voltage: float
    """V₀ [V]."""
    resistance: float
    """R [Ω]."""


@dataclass(frozen=True, eq=False)
class Plant:
    """A compiled model whose only actuators are position servos on hinges."""

    robot: Robot
    model: mujoco.MjModel
    servos: Ints
    """(n,) the actuator of each hinge, −1 for one that nothing drives."""
    notes: tuple[str, ...]
    drives: Drives | None = None
    """The servos; None if the model keeps its own actuators."""
    bodies: SimulatedBodies | None = None
    """The bodies around the robot; None without a scene."""
    supply: Supply | None = None
    """Of the servos; None for one of constant voltage."""
    policy: Any = None
    """The controller (`policy.Policy`) that makes the goals from the state; None plays those of the trajectory."""

    @property
    def backlash(self) -> float:
        """Play of every joint, either way [rad]."""
        return float(self.model.jnt_range[self.places.play, 1].max(initial=0.0))

    @cached_property
    def places(self) -> Places:
        """Where the model has the robot's coordinates."""
        return places_of(self.model, self.robot)

    @cached_property
    def ground(self) -> SolidGround:
        """The floor and the bodies at rest."""
        return SolidGround(None if self.bodies is None else self.bodies.scene)

    @cached_property
    def hinges(self) -> Ints:
        """(n,) indices of the angles that the encoders measure, in the model's configuration."""
        return self.places.qpos[self.robot.qpos_index]

    @cached_property
    def dofs(self) -> Ints:
        """(n,) indices of their speeds."""
        return self.places.dofs[self.robot.dof_index]

    @cached_property
    def root_dofs(self) -> Ints:
        """Indices of the root's velocities."""
        return self.places.dofs[root_dofs(self.robot)]

    @cached_property
    def root_coordinates(self) -> Ints:
        """Indices of the root in the robot's configuration."""
        adr = [*self.robot.model.jnt_qposadr, self.robot.model.nq]
        return np.array([c for j in self.robot.root_joints for c in range(adr[j], adr[j + 1])], dtype=np.int64)

    @property
    def servo_map(self) -> ServoMap | None:
        """The map with the limits of the goals; None if the model keeps its own actuators."""
        return None if self.drives is None else self.robot.servo_map

    @cached_property
    def driven(self) -> Ints:
        """Indices of the hinges with a servo, among the robot's hinges."""
        return np.flatnonzero(self.servos >= 0)

    @property
    def bounds(self) -> Floats:
        """(n,) the most torque each servo gives [N m], infinite where nothing bounds it."""
        model, bounds = self.model, np.array(self.robot.max_torque)
        for k in self.driven:
            servo = self.servos[k]
            if model.actuator_forcelimited[servo]:
                bounds[k] = np.abs(model.actuator_forcerange[servo] * model.actuator_gear[servo, 0]).max()
        return bounds

    def with_own_model(self) -> "Plant":
        """Return a plant that shares no model with others if its friction or supply changes from step to step, else itself."""
        varies = self.drives is not None and (self.drives.gears is not None or self.supply is not None)
        return replace(self, model=copy.copy(self.model)) if varies else self

    def step(self, data: mujoco.MjData, count: int) -> None:
        """Advance the physics by some steps."""
        drives = self.drives
        if drives is not None and self.supply is not None:
            self._sag(data, drives, self.supply)
        if drives is None or drives.gears is None:
            mujoco.mj_step(self.model, data, count)
            return
        for _ in range(count):
            drives.gears.apply(self.model, data, self.dofs, drives.friction, drives.back_emf)
            mujoco.mj_step(self.model, data)

    def _sag(self, data: mujoco.MjData, drives: Drives, supply: Supply) -> None:
        """Set the torque of the servos to that at the supply's voltage under the load of the last step."""
        model, driven = self.model, self.driven
        servos, ranges, gains, biases = self._at_nominal
        force, speed = data.qfrc_actuator[self.dofs], data.qvel[self.dofs]
        duty = force[driven] / model.actuator_forcerange[servos, 1]
        current = np.maximum(duty * drives.current(force, speed)[driven], 0.0).sum()
        share = max((supply.voltage - supply.resistance * float(current)) / drives.voltage, LEAST_SUPPLY)
        model.actuator_forcerange[servos] = share * ranges
        model.actuator_gainprm[servos, 0] = share * gains
        model.actuator_biasprm[servos, 1:3] = share * biases

    @cached_property
    def _at_nominal(self) -> tuple[Ints, Floats, Floats, Floats]:
        """Actuators (d,), force ranges (d, 2), gains (d,) and biases (d, 2) of the driven hinges at the servos' voltage."""
        model, servos = self.model, self.servos[self.driven]
        ranges, gains, biases = model.actuator_forcerange, model.actuator_gainprm, model.actuator_biasprm
        return servos, ranges[servos], gains[servos, 0], biases[servos, 1:3]

    def with_drives(self, drives: Drives) -> "Plant":
        """Return the plant with the gears and rotors of other drives; their motors are the same."""
        model = copy.copy(self.model)
        set_mechanics(model, self.dofs, drives)
        return replace(self, model=model, drives=drives)

    def controls(self, goals: Floats) -> Floats:
        """Controls (N, nu) at which every servo rests at its goal (N, n) [rad]: force g c + b₀ + b₁ r q = 0, r the gear.

        Goals are rounded to the servos' ticks where those are known.
        """
        wanted = goals[:, self.driven]
        if self.drives is not None:
            tick = self.drives.tick[self.driven]
            wanted = np.round(wanted / tick) * tick
        offset, slope = self._control_line
        controls = np.zeros((len(goals), self.model.nu))
        controls[:, self.servos[self.driven]] = offset + slope * wanted
        return controls

    @cached_property
    def _control_line(self) -> tuple[Floats, Floats]:
        """Offset and slope (d,) of the controls over the goals of the driven hinges."""
        model, servo = self.model, self.servos[self.driven]
        gain, bias = model.actuator_gainprm[servo, 0], model.actuator_biasprm[servo]
        return -bias[:, 0] / gain, -bias[:, 1] * model.actuator_gear[servo, 0] / gain

    def goal_offsets(self, torque: Floats, speed: Floats) -> Floats:
        """How far before the joints the goals must be (N, n) [rad] for the servos to give `torque` [N m] at `speed` [rad/s].

        τ = r (g c + b₀ + b₁ r q + b₂ r ω) gives u − q = (τ − r² b₂ ω) / (−r² b₁).
        """
        model, driven = self.model, self.driven
        servo = self.servos[driven]
        square = model.actuator_gear[servo, 0] ** 2
        leads = np.zeros_like(torque)
        braked = torque[:, driven] - square * model.actuator_biasprm[servo, 2] * speed[:, driven]
        leads[:, driven] = braked / (-square * model.actuator_biasprm[servo, 1])
        return leads


def set_mechanics(model: mujoco.MjModel, dofs: Ints, drives: Drives) -> None:
    """What turns with the shafts: the back-EMF acts beyond the clip of the duty, so it is a damping of the joint."""
    model.dof_damping[dofs] = drives.back_emf + drives.damping
    model.dof_frictionloss[dofs] = drives.friction
    model.dof_armature[dofs] = drives.armature
    mujoco.mj_setConst(model, mujoco.MjData(model))


def places_of(model: mujoco.MjModel, robot: Robot) -> Places:
    """Find the robot's coordinates in a model with or without passive hinges and free bodies of a scene."""
    names = [model.joint(j).name for j in range(model.njnt)]
    passive = np.array([name.startswith(PLAY) for name in names], dtype=bool)
    added = passive | np.array([name.startswith(PREFIX) for name in names], dtype=bool)
    joint_of = np.searchsorted(model.jnt_qposadr, np.arange(model.nq), side="right") - 1
    play = np.flatnonzero(passive)
    return Places(
        np.flatnonzero(~added[joint_of]), np.flatnonzero(~added[model.dof_jntid]),
        robot.qpos_index if play.size else np.zeros(0, np.int64), play, model.jnt_qposadr[play].astype(np.int64), np.array(model.qpos0),
    )  # fmt: skip


def limb_inertia(robot: Robot, model: mujoco.MjModel | None = None) -> Floats:
    """(n,) what each hinge swings in the standing pose, the rest of the robot held still [kg m²]; `model` as in a plant."""
    chosen = robot.model if model is None else model
    data, places = mujoco.MjData(chosen), places_of(chosen, robot)
    data.qpos[:] = places.model_qpos(robot.standing())
    mujoco.mj_forward(chosen, data)
    columns = np.zeros((chosen.nv, chosen.nv))
    for column, unit in zip(columns, np.eye(chosen.nv), strict=True):
        mujoco.mj_mulM(chosen, data, column, unit)
    return np.diag(columns)[places.dofs[robot.dof_index]]


def soles_and_floor(model: mujoco.MjModel, robot: Robot) -> Bools:
    """Return which geoms are those of the world and of the feet, whose contacts are the floor's."""
    return np.isin(model.geom_bodyid, [0, *feet_of(robot).all_bodies])
