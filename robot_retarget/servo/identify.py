"""Identify a servo on a pendulum: play an excitation, record the angles, fit the servo's mechanics.

    (J + J_a) q̈ = clip(g k (u − q) − g k_d q̇, ±τ_stall) − d q̇ − f sign q̇ − m g₀ l sin q

q is 0 where the pendulum hangs. Known: mass m, distance l and inertia J of the pendulum, gains k, k_d and torque τ_stall of
the datasheet. Fitted: armature J_a, dry friction f, drag d (back-EMF included), gain factor g, and the delay by which the
recorded angles follow the goals.
"""

from dataclasses import dataclass, replace
from math import copysign, inf, sin, tau
from pathlib import Path

import numpy as np

from robot_retarget.actuators.control_tables import FULL_PWM, TICKS_PER_TURN
from robot_retarget.actuators.map import Identified, Servo, ServoMap, Stop
from robot_retarget.actuators.motors import MotorModel
from robot_retarget.arrays import Floats
from robot_retarget.errors import ServoError
from robot_retarget.goals import RATE
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.servo.scale import JointScale

GRAVITY = 9.81
"""[m/s²]."""
STEP = 0.002
"""Of the simulated pendulum [s]."""
SPAN = 6.0
"""Duration of each of the four trajectories [s]."""
SWING = 0.8
"""Largest angle of the excitation [rad]; the servo's range must hold it."""
GUESS = (0.01, 0.05, 1.0, 1.0)
"""Armature [kg m²], friction [N m], drag over the back-EMF [-] and gain factor [-] from which the fit starts."""
DIFFERENCE = 1e-3
"""Relative step of the fit's finite differences [-]: dry friction makes the residual rough below it."""


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


@dataclass(frozen=True)
class Fit:
    """A servo as identified."""

    servo: Identified
    delay: float
    """By which recorded angles follow the goals [s]."""
    error: float
    """Mean absolute error of the simulated angles [rad]."""


def identify(
    servo_map: ServoMap,
    joint: str,
    pendulum: Pendulum,
    port: str | Path,
    log: str | Path,
    options: PlaybackOptions | None = None,
) -> Fit:
    """Play the excitation on one servo, record it and fit the servo.

    Args:
        joint: the joint of the map whose servo turns the pendulum.
        port: serial port of the servo, or of an emulator.
        log: file for the recorded ticks (`play.npz`).

    Raises:
        ServoError: the servo's range is too narrow, or playback was stopped.
    """
    servo = servo_map[joint]
    if not servo.lower <= -SWING <= SWING <= servo.upper:
        raise ServoError(
            f"{joint}: identification needs the range −{SWING:g}…{SWING:g} rad, with 0 where the pendulum hangs"
        )
    alone = replace(servo_map, servos=(servo,), stop=Stop())
    how = replace(options or PlaybackOptions(), tracking_rms=inf)  # steps of the excitation are off by their height
    outcome = play(excitation(), alone, port, how, log)
    if outcome.ended is not PlaybackEnd.FINISHED:
        raise ServoError(f"identification was stopped: {outcome.sentence}")
    with np.load(log) as ticks:
        playing = ticks["phase"] == list(ticks["phases"]).index("play")
        goal, present = (ticks[name][playing, 0] for name in ("goal", "present"))
    scale = JointScale(alone)
    sent = np.array([scale.radians(scale.ticks(row))[0] for row in goal[:, None]])
    return fit(sent, present, RATE, servo, pendulum)


def with_identified(servo_map: ServoMap, joint: str, found: Identified) -> ServoMap:
    """Return the map with the identified values of the servo model of a joint."""
    return replace(servo_map, identified={**servo_map.identified, servo_map[joint].type.name: found})


def excitation(rate: float = RATE) -> ServoPlan:
    """Return four trajectories in a row, each from 0 to 0: a chirp, two sines, slow ramps, and steps."""
    times = np.arange(round(SPAN * rate)) / rate
    fade = np.sin(np.pi * times / SPAN)
    chirp = 0.25 * fade * np.sin(tau * (0.3 + 0.3 * times) * times)
    sines = 0.6 * fade * (0.7 * np.sin(tau * 0.5 * times) + 0.3 * np.sin(tau * 1.7 * times))
    ramps = SWING * np.interp(times, SPAN * np.array([0, 0.25, 0.75, 1]), [0, 1, -1, 0])
    steps = np.array([0.0, 0.4, -0.4, SWING, 0.2, 0.0])[(times / SPAN * 6).astype(int)]
    path = np.concatenate([chirp, sines, ramps, steps])
    return ServoPlan(path[:, None], rate)


def fit(sent: Floats, present: Floats, rate: float, servo: Servo, pendulum: Pendulum) -> Fit:
    """Fit a servo's mechanics and its delay to recorded goals and angles, by least squares of simulated angles.

    Args:
        sent: (N,) goals as the servo received them [rad].
        present: (N,) angles read in the same ticks [rad].
        rate: ticks a second [1/s].
        servo: gives the motor of the datasheet and the gear.
        pendulum: the load on the shaft.

    Returns:
        Damping, friction, armature and gain factor, the delay, and the error of the simulated angles.
    """
    from scipy.optimize import least_squares

    motor, times = servo.type.motor, np.arange(len(sent)) / rate
    steps = round(1 / (rate * STEP))
    fine = np.arange(steps * len(sent)) * STEP

    def error(logs: Floats) -> Floats:
        armature, friction, drag, gain = np.exp(logs[:4])
        path = simulated(
            sent, steps, motor, servo.gear, pendulum, (armature, friction, drag * motor.back_emf, gain), present[0]
        )
        return np.interp(times - logs[4] / rate, fine, path) - present

    found = least_squares(error, [*np.log(GUESS), 0.5], diff_step=DIFFERENCE, x_scale=[1, 1, 0.3, 0.1, 1])
    armature, friction, drag, gain = np.exp(found.x[:4]).tolist()
    damping = max((drag - 1) * motor.back_emf, 0.0)
    identified = Identified(round(damping, 5), round(friction, 5), round(armature, 6), round(gain, 4))
    return Fit(identified, float(found.x[4]) / rate, float(np.abs(found.fun).mean()))


def simulated(
    sent: Floats,
    steps: int,
    motor: MotorModel,
    gear: float,
    pendulum: Pendulum,
    parameters: tuple[float, float, float, float],
    start: float,
) -> Floats:
    """Return the angles (N · steps,) of a pendulum whose servo gets goals (N,) [rad], each held for some steps.

    Args:
        parameters: armature [kg m²], friction [N m], drag [N m s/rad] and gain factor [-], at the servo's shaft.
    """
    armature, friction, drag, gain = parameters
    ticks, square = TICKS_PER_TURN / tau / FULL_PWM, gear**2
    stiffness = square * gain * motor.stall_torque * motor.p_gain / motor.p_divisor * ticks
    brake = square * gain * motor.stall_torque * motor.d_gain / 16 / 1000 * ticks
    inertia, limit = pendulum.inertia + square * armature, gear * motor.stall_torque
    weight, slowed = pendulum.mass * GRAVITY * pendulum.length, inertia + STEP * square * drag
    grip = gear * friction * STEP / slowed
    path, angle, speed = [], float(start), 0.0
    for goal in sent.tolist():
        for _ in range(steps):
            path.append(angle)
            torque = max(-limit, min(limit, stiffness * (goal - angle) - brake * speed))
            speed = (inertia * speed + STEP * (torque - weight * sin(angle))) / slowed
            speed = 0.0 if abs(speed) <= grip else speed - copysign(grip, speed)
            angle += STEP * speed
    return np.array(path)
