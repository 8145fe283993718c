"""Motors of position servos, as their makers' datasheets have them: one line of the speed–torque plane each.

    τ(duty, ω) = τ_stall (duty − ω / ω_0)        I = I_stall (duty − ω / ω_0)

at the nominal voltage; another voltage scales what duty gives, not what speed takes away.
"""

import csv
import re
from contextlib import suppress
from dataclasses import dataclass, fields
from math import copysign, tau
from pathlib import Path
from typing import Any

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY
from robot_retarget.base.errors import ServoError, known

TICKS_PER_TURN = 4096
"""Of the encoder of X and MX servos, as the manual states; `MotorModel.ticks_per_turn` has that of each servo."""
SUPPLY_RESISTANCE = 0.1
"""Of battery and leads [Ω]: three cells of 10 mΩ and 2 m of cable of 0.5 mm²."""
FULL_PWM = 885
"""Of the register `goal_pwm`: full duty."""
CONTINUOUS_SHARE = 0.2
"""Of stall torque and current that may last: the maker's manuals call motions stable at a fifth of stall or less."""
ROOM = 30.0
"""Temperature of a room, and of a rested servo [°C]: 50 K below the shutdown of an XM430 at 80 °C in its data sheet."""
HEAT_RISE = 80.0 - ROOM
"""Final temperature rise at the continuous current [K]: to that shutdown."""
HEAT_TIME = 300.0
"""Time constant of that warming [s]."""


@dataclass(frozen=True)
class MotorModel:
    """A servo's motor with its gears, at the output shaft, and the gains it leaves the factory with."""

    name: str
    stall_torque: float
    """[N m]."""
    stall_current: float
    """[A]."""
    no_load_speed: float
    """[rad/s]."""
    voltage: float = 12.0
    """At which the data sheet states the three above [V]."""
    p_gain: int = 800
    """Register `position_p_gain`: duty = P / p_divisor / 885 for a tick of error."""
    d_gain: int = 0
    """Register `position_d_gain`: duty = D / 16 / 885 for a tick a millisecond."""
    p_divisor: float = 128
    """Of the register `position_p_gain`, as in the manual. Rhoban BAM measured 256 for the XL330, and 4.66 for the MX under
    Protocol 1 (0.158 of the duty for a radian and a unit of gain). The AX has a slope of 32 steps to full duty instead."""
    ticks_per_turn: float = TICKS_PER_TURN
    """Of the encoder; AX and XL-320 have 1024 steps for 300°."""

    @property
    def ticks_per_radian(self) -> float:
        """Of the encoder [1/rad]."""
        return self.ticks_per_turn / tau

    @property
    def back_emf(self) -> float:
        """Torque that speed takes away [N m s/rad]."""
        return self.stall_torque / self.no_load_speed

    def stall_at(self, voltage: float) -> float:
        """Return the torque of full duty at standstill [N m] on a supply [V]."""
        return self.stall_torque * voltage / self.voltage

    def current(self, duty: float, speed: float, voltage: float) -> float:
        """Return the current of the winding [A] at a duty and a speed [rad/s] on a supply [V]."""
        return self.stall_current * (duty * voltage / self.voltage - speed / self.no_load_speed)

    def duty_per_error(self, p_gain: int | None = None) -> float:
        """Return the duty per error of the position [1/rad], at the factory's gain by default."""
        return (self.p_gain if p_gain is None else p_gain) / self.p_divisor / FULL_PWM * self.ticks_per_radian

    def duty_per_speed(self, d_gain: int | None = None) -> float:
        """Return the duty per error of the speed [s/rad], at the factory's gain by default."""
        return (self.d_gain if d_gain is None else d_gain) / 16 / 1000 / FULL_PWM * self.ticks_per_radian

    @property
    def continuous_current(self) -> float:
        """That may last [A]."""
        return CONTINUOUS_SHARE * self.stall_current


def read_table(name: str) -> list[dict[str, Any]]:
    """Return the rows of a table of this folder: texts and numbers by the heads of their columns."""
    with Path(__file__).with_name(name).open(newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return [dict(zip(heads, (cells[0], *map(_value, cells[1:])), strict=True)) for cells in rows]


def _value(cell: str) -> int | float | str:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(cell)
    return cell


SERVOS = read_table("servos.csv")
"""A servo a row, from the specifications and the control table of its page: https://emanual.robotis.com/docs/en/dxl/"""
MOTORS = {row["name"]: MotorModel(**{f.name: row[f.name] for f in fields(MotorModel)}) for row in SERVOS}


def motor_named(name: str) -> MotorModel:
    """A motor by the name printed on the servo, without the letters of its connector and case (-R, -T, AR, AT, A, F).

    Raises:
        ServoError: the servo is unknown.
    """
    plain = re.sub(r"(?<=\d)(-[RT]|A?[RT]|[AF+])(?=$|\()", "", name.strip().upper())
    if plain not in MOTORS:
        raise ServoError(f"no servo model {name!r}; {known(MOTORS, typed=name)}")
    return MOTORS[plain]


# Gears and rotor of a servo: published identifications, and the motion of a shaft that a motor turns.
#
# J ω' = τ − d ω − f sign ω


@dataclass(frozen=True)
class Mechanics:
    """What gears and rotor add to a motor, at the output shaft."""

    damping: float
    """Besides the back-EMF [N m s/rad]."""
    friction: float
    """Dry [N m]."""
    armature: float
    """[kg m²]."""


PUBLISHED = {
    "XM430-W350": {"ROBOTIS OP3": Mechanics(0.233, 0.03, 0.045), "ToddlerBot": Mechanics(0.0, 0.134, 0.0012)},
    "XM430-W210": {"ToddlerBot": Mechanics(0.0, 0.134, 0.0012)},
    "XC330-T288": {"ToddlerBot": Mechanics(0.0, 0.014, 0.0035)},
    "XC430-W240": {"ToddlerBot": Mechanics(0.0, 0.069, 0.004)},
    "2XC430-W250": {"ToddlerBot": Mechanics(0.0, 0.252, 0.0044)},
    "2XL430-W250": {"ToddlerBot": Mechanics(0.0, 0.292, 0.0042)},
    "XL430-W250": {"ToddlerBot": Mechanics(0.0, 0.292, 0.0042)},
}
"""Identifications by servo and by the robot they were made on; the first is the nominal one.

The identification of the OP3 is from MuJoCo Menagerie; its joint damping of 1.084 includes the back-EMF of 0.851. Those of ToddlerBot (62cee1b)
include it too: its motor model has no torque of speed below the speed of full torque. They are .075 to .134, less than the back-EMF of the data sheets, so
that no damping is left for the gears. The XL430 has the gears of the 2XL430.
"""
IDENTIFIED = {name: next(iter(sets.values())) for name, sets in PUBLISHED.items()}
REFERENCE = "XM430-W350"
"""Servos without an identification have the mechanics of this one, scaled by the stall torque."""


def mechanics_of(motor: MotorModel) -> Mechanics:
    """As identified, else those of `REFERENCE` by stall torque."""
    if motor.name in IDENTIFIED:
        return IDENTIFIED[motor.name]
    share = motor.stall_torque / MOTORS[REFERENCE].stall_torque
    like = IDENTIFIED[REFERENCE]
    return Mechanics(share * like.damping, share * like.friction, share * like.armature)


def next_speed(speed: float, torque: float, inertia: float, drag: float, friction: float, dt: float) -> float:
    """Return the speed of a shaft after a step; drag and friction are taken implicitly [rad/s].

    Args:
        speed: before the step [rad/s].
        torque: of motor and load [N m].
        inertia: of rotor and load [kg m²].
        drag: back-EMF and damping [N m s/rad].
        friction: dry [N m].
        dt: the step [s].
    """
    free, slowed = inertia * speed + dt * torque, inertia + dt * drag
    return 0.0 if abs(free) <= dt * friction else (free - copysign(dt * friction, free)) / slowed


# A known load on a servo's shaft, by which it is identified.


@dataclass(frozen=True)
class Pendulum:
    """What turns with the shaft; the axis is horizontal."""

    mass: float
    """[kg]."""
    length: float
    """From the axis to the centre of mass [m]."""
    inertia: float = 0.0
    """About the axis [kg m²]; 0 takes that of a point mass."""

    def __post_init__(self) -> None:
        for name, low, high in (("mass", 1e-3, 50.0), ("length", 1e-3, 5.0), ("inertia", 0.0, 100.0)):
            if not low <= getattr(self, name) <= high:
                raise ServoError(f"the pendulum's {name} {getattr(self, name):g} is not in {low:g}…{high:g}")
        if not self.inertia:
            object.__setattr__(self, "inertia", self.mass * self.length**2)

    @property
    def weight(self) -> float:
        """Torque of its weight when it is horizontal [N m]."""
        return self.mass * STANDARD_GRAVITY * self.length
