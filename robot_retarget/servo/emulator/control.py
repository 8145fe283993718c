"""The position controller of a servo: from goal and gains to the duty of the motor."""

from robot_retarget.actuators.motors import FULL_PWM
from robot_retarget.servo.emulator.registers import CURRENT_POSITION, POSITIONS, Registers
from robot_retarget.servo.emulator.shaft import Shaft


def drive(mode: int, r: Registers, shaft: Shaft, now: float, dt: float) -> None:
    """Set the motor's duty for the next `dt` [s]; modes that do not control the position leave the motor without current."""
    motor, elapsed = shaft.motor, now - shaft.since
    if mode not in POSITIONS:
        motor.duty = 0.0
        return
    limit = abs(r["goal_pwm"]) / FULL_PWM
    if mode == CURRENT_POSITION:
        limit = min(limit, abs(r["goal_current"]) * motor.model.current_unit / motor.model.motor.stall_current)
    gains = r["position_p_gain"], r["position_i_gain"], r["position_d_gain"]
    target = shaft.to_encoder(shaft.path.position(elapsed))
    motor.control_position(target, shaft.direction * shaft.path.velocity(elapsed), gains, limit, dt)
