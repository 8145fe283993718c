"""Operating modes and drive modes: their numbers, and which goal, gains and limits belong to them."""

from collections.abc import Container

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
REVERSE, TIME_BASED, TORQUE_BY_GOAL = 1, 4, 8
"""Bits of `drive_mode`."""
HOMING_REACH = 1024
"""In position mode a larger homing offset has no effect."""
GOALS = {
    POSITION: "goal_position",
    EXTENDED: "goal_position",
    CURRENT_POSITION: "goal_position",
    VELOCITY: "goal_velocity",
    CURRENT: "goal_current",
    PWM: "goal_pwm",
}
POSITIONS = (POSITION, EXTENDED, CURRENT_POSITION)
"""Modes that control the position; a change to one of them brings back the factory's gains."""
LIMITED = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}


def allowed_modes(registers: Container[str]) -> tuple[int, ...]:
    """The modes of a servo with these registers: without a goal current none of those that control it."""
    return tuple(GOALS) if "goal_current" in registers else (VELOCITY, POSITION, EXTENDED, PWM)
