"""The controllers of a servo by operating mode: from goals and gains to the duty of the motor."""

from robot_retarget.actuators.motors import FULL_PWM
from robot_retarget.servo.emulator import profile
from robot_retarget.servo.emulator.modes import CURRENT, CURRENT_POSITION, POSITIONS, PWM, VELOCITY
from robot_retarget.servo.emulator.registers import Registers
from robot_retarget.servo.emulator.shaft import Shaft


def drive(mode: int, r: Registers, shaft: Shaft, now: float, dt: float, stopped: bool) -> None:
    """Set the motor's duty for the next `dt` [s]; `stopped` by the watchdog, goals of speed and effort count as 0."""
    motor, sense = shaft.motor, shaft.direction
    limit = (abs(r["goal_pwm"]) if mode != PWM else r["pwm_limit"]) / FULL_PWM
    if mode in POSITIONS:
        _position(mode, r, shaft, now, dt, limit)
    elif mode == VELOCITY:
        goal = 0 if stopped else r["goal_velocity"]
        motor.run(sense * goal * profile.VELOCITY, (r["velocity_p_gain"], r["velocity_i_gain"]), limit, dt)
    elif mode == CURRENT:
        motor.control_current(0.0 if stopped else sense * r["goal_current"] * motor.model.current_unit, limit)
    else:
        motor.duty = 0.0 if stopped else sense * max(-limit, min(limit, r["goal_pwm"] / FULL_PWM))


def _position(mode: int, r: Registers, shaft: Shaft, now: float, dt: float, limit: float) -> None:
    motor, elapsed = shaft.motor, now - shaft.since
    if mode == CURRENT_POSITION:
        limit = min(limit, abs(r["goal_current"]) * motor.model.current_unit / motor.model.motor.stall_current)
    gains = r["position_p_gain"], r["position_i_gain"], r["position_d_gain"]
    target = shaft.to_encoder(shaft.path.position(elapsed))
    motor.control_position(target, shaft.direction * shaft.path.velocity(elapsed), gains, limit, dt)
