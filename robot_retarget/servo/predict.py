"""Predict recorded joint angles from recorded goals with the model of the servos.

The log is that of `play`, or the actions and states of any robot. Each servo is simulated alone, with the mechanics of the map or
the published ones and a load of known inertia; gravity and other joints act in the log alone.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.actuators.map import Servo, ServoMap
from robot_retarget.actuators.motors import Pendulum, mechanics_of
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError, known
from robot_retarget.servo.emulator.world import STEP
from robot_retarget.servo.identify import simulated
from robot_retarget.servo.played import ServoLog


@dataclass(frozen=True, eq=False)
class Prediction:
    """One joint of a log, as the model of its servo has it."""

    joint: str
    model: str
    goals: Floats
    """(N,) [rad]."""
    measured: Floats
    """(N,) [rad]."""
    predicted: Floats
    """(N,) [rad]."""

    @property
    def error(self) -> float:
        """Of the predicted angles (rms) [rad]."""
        return float(np.sqrt(np.mean((self.predicted - self.measured) ** 2)))

    @property
    def error_of_goals(self) -> float:
        """Of the goals in place of a prediction (rms) [rad]."""
        return float(np.sqrt(np.mean((self.goals - self.measured) ** 2)))


def predict(log: ServoLog, servo_map: ServoMap, load: float | Floats = 0.0) -> list[Prediction]:
    """Return a prediction for each joint that log and map share, in the order of the map.

    Args:
        log: goals and angles.
        servo_map: models, gears and identified mechanics.
        load: inertia that each joint carries, about its axis [kg m²], or the torque (N,) of its load at each row [N m].

    Raises:
        ServoError: Log and map share no joint.
    """
    shared = [servo for servo in servo_map.servos if servo.joint in log.joints]
    if not shared:
        raise ServoError(f"the log has no joint of the map: {known(log.joints, typed=servo_map.joints[0])}")
    return [_predicted(log, servo_map, servo, load) for servo in shared]


def _predicted(log: ServoLog, servo_map: ServoMap, servo: Servo, load: float | Floats) -> Prediction:
    column, motor = log.joints.index(servo.joint), servo.motor
    goals, measured = log.goals[:, column], log.angles[:, column]
    own = servo_map.identified.get(servo.type.name)
    found = own or mechanics_of(motor)
    times = np.arange(round((len(goals) - 1) / log.rate / STEP) + 1) * STEP
    row = np.minimum(((times + STEP / 2) * log.rate).astype(int), len(goals) - 1)  # a goal comes at the nearest step
    carried = load[row] if isinstance(load, np.ndarray) else Pendulum(1e-3, 1e-3, load)
    voltage = motor.voltage if log.voltage is None else log.voltage
    gain = own.gain if own else 1.0
    parameters = found.armature, found.friction, found.damping + motor.back_emf, gain
    path = simulated(goals[row], 1, servo, carried, voltage, parameters, measured[0])
    predicted = np.interp(np.arange(len(goals)) / log.rate, times, path)
    return Prediction(servo.joint, servo.type.name, goals, measured, predicted)
