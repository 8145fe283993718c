"""Predict recorded joint angles from recorded goals with the model of the servos.

The log is that of `play`, or the actions and states of any robot. Each servo is simulated alone, with the mechanics of the map or
the published ones and a load of known inertia; gravity and other joints act in the log alone.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import Servo, ServoMap
from robot_retarget.actuators.motors import mechanics_of
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError, known
from robot_retarget.servo.emulator.world import STEP
from robot_retarget.servo.identify import simulated
from robot_retarget.servo.outcome import PHASES


@dataclass(frozen=True, eq=False)
class ServoLog:
    """Goals and angles of joints at even times."""

    joints: tuple[str, ...]
    rate: float
    """Rows a second [1/s]."""
    goals: Floats
    """(N, n) [rad], each held until the next."""
    angles: Floats
    """(N, n) measured [rad], at the times of the goals."""
    voltage: float | None = None
    """Mean of the supply [V]; None takes each servo's nominal one."""

    def __post_init__(self) -> None:
        if self.goals.shape != self.angles.shape or self.goals.shape[1:] != (len(self.joints),):
            raise ServoError(f"{len(self.joints)} joints, goals {self.goals.shape} and angles {self.angles.shape}")
        if len(self.goals) < 2 or not np.isfinite([self.goals, self.angles]).all():
            raise ServoError("a log needs at least two rows, and finite goals and angles")


def read_play_log(path: str | Path) -> ServoLog:
    """Read the played ticks of a `play.npz`.

    Raises:
        ServoError: The file is no log of `play`, or nothing was played.
    """
    try:
        with np.load(path, allow_pickle=False) as log:
            playing = log["phase"] == PHASES.index("play")
            time, goals, angles, voltage = (log[key][playing] for key in ("time", "goal", "present", "voltage"))
            joints = tuple(map(str, log["joint_names"]))
    except (OSError, ValueError, KeyError) as error:
        raise ServoError(f"{path} is no log of `play`: {error}") from error
    if len(time) < 2:
        raise ServoError(f"{path}: nothing was played")
    rate = float(1 / np.median(np.diff(time)))
    return ServoLog(joints, rate, goals, angles, float(voltage.mean()))


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


def predict(log: ServoLog, servo_map: ServoMap, load: float = 0.0) -> list[Prediction]:
    """Return a prediction for each joint that log and map share, in the order of the map.

    Args:
        log: goals and angles.
        servo_map: models, gears and identified mechanics.
        load: inertia that each joint carries, about its axis [kg m²].

    Raises:
        ServoError: Log and map share no joint.
    """
    shared = [servo for servo in servo_map.servos if servo.joint in log.joints]
    if not shared:
        raise ServoError(f"the log has no joint of the map: {known(log.joints, typed=servo_map.joints[0])}")
    return [_predicted(log, servo_map, servo, load) for servo in shared]


def _predicted(log: ServoLog, servo_map: ServoMap, servo: Servo, load: float) -> Prediction:
    column, motor = log.joints.index(servo.joint), servo.motor
    goals, measured = log.goals[:, column], log.angles[:, column]
    own = servo_map.identified.get(servo.type.name)
    found = own or mechanics_of(motor)
    times = np.arange(round((len(goals) - 1) / log.rate / STEP) + 1) * STEP
    held = goals[np.minimum((times * log.rate + 1e-9).astype(int), len(goals) - 1)]
    voltage = motor.voltage if log.voltage is None else log.voltage
    gain = own.gain if own else 1.0
    parameters = found.armature, found.friction, found.damping + motor.back_emf, gain
    path = simulated(held, 1, servo, load, 0.0, voltage, parameters, measured[0])
    predicted = np.interp(np.arange(len(goals)) / log.rate, times, path)
    return Prediction(servo.joint, servo.type.name, goals, measured, predicted)
