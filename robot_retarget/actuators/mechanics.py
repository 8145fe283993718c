"""Gears and rotor of a servo: published identifications, and the motion of a shaft that a motor turns.

J ω' = τ − d ω − f sign ω
"""

from dataclasses import dataclass
from math import copysign

from robot_retarget.actuators.motors import MOTORS, MotorModel


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
    "XM430-W350": {"ROBOTIS OP3": Mechanics(0.233, 0.03, 0.045), "ToddlerBot": Mechanics(0.08, 0.134, 0.0012)},
    "XM430-W210": {"ToddlerBot": Mechanics(0.08, 0.134, 0.0012)},
    "XC330-T288": {"ToddlerBot": Mechanics(0.134, 0.014, 0.0035)},
    "XC430-W240": {"ToddlerBot": Mechanics(0.127, 0.069, 0.004)},
    "2XC430-W250": {"ToddlerBot": Mechanics(0.075, 0.252, 0.0044)},
    "2XL430-W250": {"ToddlerBot": Mechanics(0.12, 0.292, 0.0042)},
    "XL430-W250": {"ToddlerBot": Mechanics(0.12, 0.292, 0.0042)},
}
"""Identifications by servo and by the robot they were made on; the first is the nominal one.

The identification of the OP3 is from MuJoCo Menagerie; its joint damping of 1.084 includes the back-EMF of 0.851. The XL430 has the gears of
the 2XL430.
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
