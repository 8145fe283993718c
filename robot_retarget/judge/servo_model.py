"""Model of position servos: a DC motor on a supply, driven by the P and D of its registers.

    duty  = clip(k_p (u − q) − k_d ω, ±1)
    τ     = τ_stall duty − k_e ω                       k_e = τ_stall / ω_0, the torque–speed line
    J q̈   = τ − d ω − f sign ω + load                  d, f, J of the gears and the rotor
    I     = I_stall duty − I_stall ω / ω_0             P_heat = I² R

Speed takes its torque away outside the clip, so the whole is a position actuator with a force range and a damped joint: MuJoCo's
`position` exists in every version, integrates the damping implicitly, and agrees with its `dcmotor`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from robot_retarget.actuators.map import Identified
from robot_retarget.actuators.motors import (
    HEAT_RISE,
    HEAT_TIME,
    IDENTIFIED,
    REFERENCE,
    Mechanics,
    MotorModel,
    mechanics_of,
    motor_named,
)
from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.errors import RobotError
from robot_retarget.robot.model import Robot

# Friction of gears that depends on load and speed: the form M4 of Rhoban's BAM (Duclusaud et al., 2025).
#
#     f = f_c + l |τ_m − τ_e| + s (f_s + l_s |τ_m − τ_e|),      s = exp(−|ω / ω_s|^α)
#
# τ_m is the torque of the motor with its back-EMF, τ_e that of gravity, contacts and the other bodies. f_c is the dry friction of
# `Drives.friction`. MuJoCo stops a joint with up to `frictionloss`, which `apply` sets to f at each step.


@dataclass(frozen=True, eq=False)
class GearFriction:
    """What load and rest add to the dry friction of n joints."""

    static: Floats
    """f_s (n,): more at rest [N m]."""
    load: Floats
    """l (n,): per torque through the gears [-]."""
    static_load: Floats
    """l_s (n,): more of that at rest [-]."""
    speed: Floats
    """ω_s (n,): where the part at rest has fallen to 1/e [rad/s]."""
    shape: Floats
    """α (n,) [-]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, frozen(value))

    def more(self, motor: Floats, external: Floats, speed: Floats) -> Floats:
        """Return f − f_c (n,) [N m] for torques (n,) [N m] and speeds (n,) [rad/s]."""
        through = np.abs(motor - external)
        rest = np.exp(-(np.abs(speed / self.speed) ** self.shape))
        return self.load * through + rest * (self.static + self.static_load * through)

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData, dofs: Ints, dry: Floats, back_emf: Floats) -> None:
        """Set the friction of the next step from the forces of the last one.

        Args:
            dofs: (n,) of the joints.
            dry: f_c (n,) [N m].
            back_emf: (n,) torque per speed [N m s/rad].
        """
        speed = data.qvel[dofs]
        motor = data.qfrc_actuator[dofs] - back_emf * speed
        external = data.qfrc_constraint[dofs] - _friction(data, model.nv)[dofs] - data.qfrc_bias[dofs]
        model.dof_frictionloss[dofs] = dry + self.more(motor, external, speed)


def _friction(data: mujoco.MjData, dofs: int) -> Floats:
    """The friction (dofs,) among the forces of the last step's constraints [N m]."""
    found = np.zeros(dofs)
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    found[data.efc_id[rows]] = data.efc_force[rows]
    return found


@dataclass(frozen=True, eq=False)
class Drives:
    """The servos of a robot's n hinges, at the joint: gears between servo and joint are in the numbers."""

    stiffness: Floats
    """(n,) torque per error, k_p τ_stall [N m/rad]."""
    derivative: Floats
    """(n,) torque per speed of the register's D, k_d τ_stall [N m s/rad]."""
    stall_torque: Floats
    """(n,) at the supply's voltage [N m]."""
    back_emf: Floats
    """(n,) torque that speed takes away [N m s/rad]."""
    damping: Floats
    """(n,) of the gears [N m s/rad]."""
    friction: Floats
    """(n,) [N m]."""
    armature: Floats
    """(n,) [kg m²]."""
    ratio: Floats
    """(n,) turns of the servo for one of the joint."""
    tick: Floats
    """(n,) goals are whole multiples of this [rad]."""
    stall_current: Floats
    """(n,) at the supply's voltage [A]."""
    continuous_current: Floats
    """(n,) [A]."""
    voltage: float
    """Of the supply [V]."""
    notes: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    """n servo models; empty if unknown."""
    gears: GearFriction | None = None
    """Additional friction that depends on load and speed; None without it."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray | list):
                object.__setattr__(self, name, frozen(value))

    def of(self, chosen: Ints) -> "Drives":
        """Those of some of the hinges."""
        picked = {name: value[chosen] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return replace(self, **picked)

    def with_mechanics(self, mechanics: Sequence[Mechanics]) -> "Drives":
        """Return the same motors with other gears and rotors (n), given at the servos' shafts."""
        gears = self.ratio
        damping, friction, armature = np.array([(m.damping, m.friction, m.armature) for m in mechanics]).T
        return replace(self, damping=gears**2 * damping, friction=gears * friction, armature=gears**2 * armature)

    def scaled(self, factors: Floats) -> "Drives":
        """Return the same motors with damping, friction and armature times factors (3, n)."""
        damping, friction, armature = factors * [self.damping, self.friction, self.armature]
        return replace(self, damping=damping, friction=friction, armature=armature)

    @property
    def no_load_speed(self) -> Floats:
        """(n,) [rad/s]."""
        return self.stall_torque / self.back_emf

    def duty(self, force: Floats) -> Floats:
        """The part of the supply on the windings, −1 … 1, at actuator forces (…, n) [N m]."""
        return force / self.stall_torque

    def shaft_torque(self, force: Floats, speed: Floats) -> Floats:
        """Return the torques at the shafts (…, n) [N m] for actuator forces [N m] and joint speeds [rad/s]."""
        return force - self.back_emf * speed

    def current(self, force: Floats, speed: Floats) -> Floats:
        """(…, n) [A]."""
        return self.stall_current * self.shaft_torque(force, speed) / self.stall_torque

    def power(self, force: Floats, speed: Floats) -> Floats:
        """Return the power from the supply (…, n) [W]; the supply stores no power of a braking motor."""
        return np.maximum(self.voltage * self.duty(force) * self.current(force, speed), 0)

    def temperature_rise(self, force: Floats, speed: Floats, dt: float) -> Floats:
        """(n,) how much warmer the servos are after N samples (N, n), dt [s] apart, than before [K].

        The heat I² R of the continuous current would bring HEAT_RISE in the end, with the time constant HEAT_TIME.
        """
        load = (self.current(force, speed) / self.continuous_current) ** 2
        fading = np.exp(-np.arange(len(load))[::-1] * dt / HEAT_TIME)
        return HEAT_RISE * dt / HEAT_TIME * (fading[:, None] * load).sum(0)


def drives_of(robot: Robot) -> Drives | None:
    """The servos of the robot's map at their nominal voltage and the map's gains, or None for a robot without servos.

    Raises:
        RobotError: a hinge has no servo.
    """
    servo_map = robot.servo_map
    if servo_map is None or not servo_map.servos:
        return None
    bare = [joint for joint in robot.joint_names if joint not in servo_map.joints]
    if bare:
        raise RobotError(f"{robot.name}: no servo for the joint {bare[0]!r}")
    servos = [servo_map[joint] for joint in robot.joint_names]
    gears = np.array([servo.gear for servo in servos])
    found = drives([servo.motor for servo in servos], gears)
    own = [servo_map.identified.get(model) for model in found.models]
    if not any(own):
        return found
    mechanics = [one and Mechanics(one.damping, one.friction, one.armature) for one in own]
    gain = np.array([one.gain if one else 1.0 for one in own])
    known = [mine or mechanics_of(motor_named(model)) for mine, model in zip(mechanics, found.models, strict=True)]
    scaled = replace(found, stiffness=gain * found.stiffness, derivative=gain * found.derivative)
    return replace(scaled.with_mechanics(known), gears=_gear_friction(own, gears))


def _gear_friction(identified: Sequence[Identified | None], gears: Floats) -> GearFriction | None:
    """Return the load-dependent friction of identified servos (n,) behind gears (n,), at the joints; None if no servo has any."""
    found = [one or Identified(0.0, 0.0, 0.0) for one in identified]
    if not any(one.static or one.load or one.static_load for one in found):
        return None
    static, load, more, speed, shape = np.array(
        [(one.static, one.load, one.static_load, one.rest_speed, one.rest_shape) for one in found]
    ).T
    return GearFriction(gears * static, load, more, speed / gears, shape)


def drives(motors: list[MotorModel], gears: Floats) -> Drives:
    """Motors (n,) behind `gears` (n,), turns of the servo for one of the joint, as drives of the joints."""
    stall = np.array([motor.stall_torque for motor in motors])
    mechanics = [mechanics_of(motor) for motor in motors]
    unknown = sorted({motor.name for motor in motors} - IDENTIFIED.keys())
    return Drives(
        stiffness=gears**2 * stall * [motor.duty_per_error() for motor in motors],
        derivative=gears**2 * stall * [motor.duty_per_speed() for motor in motors],
        stall_torque=gears * stall,
        back_emf=gears**2 * np.array([motor.back_emf for motor in motors]),
        damping=gears**2 * np.array([m.damping for m in mechanics]),
        friction=gears * np.array([m.friction for m in mechanics]),
        armature=gears**2 * np.array([m.armature for m in mechanics]),
        ratio=gears,
        tick=1 / (gears * [motor.ticks_per_radian for motor in motors]),
        stall_current=np.array([motor.stall_current for motor in motors]),
        continuous_current=np.array([motor.continuous_current for motor in motors]),
        voltage=max(motor.voltage for motor in motors),
        models=tuple(motor.name for motor in motors),
        notes=tuple(
            f"the gears of {name} are not identified: those of {REFERENCE}, scaled by the stall torque"
            for name in unknown
        ),
    )
