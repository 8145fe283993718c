"""Identify a servo on a pendulum: play an excitation, record the angles, fit the servo's mechanics.

    (J + J_a) q̈ = clip(g k (u − q) − g k_d q̇, ±τ_stall) − d q̇ − f sign q̇ − m g₀ l sin q

From a log of `play`, the torque of a model's limb at the recorded angles takes the place of the pendulum (`from_log`).

q is 0 where the pendulum hangs. Known: mass m, distance l and inertia J of the pendulum, gains k, k_d and torque τ_stall of
the datasheet at the measured supply. Fitted: armature J_a, dry friction f, drag d (back-EMF included), gain factor g, and the delay by which the
recorded angles follow the goals.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, sin, tau
from pathlib import Path

import numpy as np

from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.map import Identified, Servo, ServoMap, Stop
from robot_retarget.actuators.motors import Pendulum, next_speed
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.emulator.world import STEP
from robot_retarget.servo.link import JointScale
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.play import play
from robot_retarget.servo.played import ServoLog

SPAN = 6.0
"""Duration of each of the four trajectories [s]: of a simulated servo a friction of 0.05 N m is found as 0.0493, with
half of it as 0.0496 and with double as 0.0498."""
SWING = 0.8
"""Largest angle of the excitation [rad]; the servo's range must hold it. With half and with double that friction is
found as 0.0495 and 0.0494."""
GUESS = (0.01, 0.05, 1.0, 1.0)
"""Armature [kg m²], friction [N m], drag over the back-EMF [-] and gain factor [-] from which the fit starts; from half
and double of all it ends at the same."""
FITTED = ("damping", "friction", "armature", "gain")
CORRELATED = 1.0
"""Time within which residuals are correlated [s]. Of 20 simulated servos whose angles are read up to 4 ms late, the truth is
inside two standard errors 19 times or more for each parameter, measured; of twelve with 0.25 s ten times, with 3 s nine."""
TRAVEL = 0.4
"""A joint of a log that moves less is refused [rad]: half of `SWING`."""
POOR = 0.01
"""A fit with a larger mean error of the angles is refused [rad]: 6.5 ticks; good fits on the emulator have less than 1e-3."""
WEIGHT_FACTOR = 2.0
"""The weight that fits best is within this factor of the pendulum's; a stall torque below the datasheet's moves it too."""
DIFFERENCE = 1e-3
"""Relative step of the fit's finite differences [-]: dry friction makes the residual rough below it. Half and double
change the fit by at most 1e-4."""


@dataclass(frozen=True)
class Fit:
    """A servo as identified."""

    servo: Identified
    spread: Mapping[str, float]
    """Standard errors of damping, friction, armature and gain."""
    delay: float
    """By which recorded angles follow the goals [s]."""
    error: float
    """Mean absolute error of the simulated angles [rad]."""
    voltage: float
    """Mean of the supply during the measurement [V]."""
    weight: float
    """Weight of the pendulum that fits best, over the stated one [-]."""


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
        ServoError: the servo's range is too narrow, playback was stopped, or the servo with this pendulum does not fit the angles.
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
        goal, present, voltage = (ticks[name][playing, 0] for name in ("goal", "present", "voltage"))
    scale = JointScale(alone)
    sent = np.array([scale.radians(scale.ticks(row))[0] for row in goal[:, None]])
    return fit(sent, present, RATE, servo, pendulum, float(voltage.mean()))


def from_log(log: ServoLog, servo_map: ServoMap, joint: str, loads: Floats) -> Fit:
    """Fit a servo to a joint of a playback.

    Args:
        log: goals and angles.
        servo_map: of the robot.
        joint: the joint.
        loads: (N,) torque that its limb needs at each row of the log [N m], as `twin.limb_torques` computes it.

    Raises:
        ServoError: the joint hardly moves, or the servo with this load does not fit the angles.
    """
    servo, column = servo_map[joint], log.joints.index(joint)
    travel = float(np.ptp(log.angles[:, column]))
    if travel < TRAVEL:
        raise ServoError(
            f"{joint} moves by {travel:.2f} rad in the log: {TRAVEL:g} are needed to tell its parameters apart"
        )
    times = np.arange(round((len(log.goals) - 1) / log.rate * RATE) + 1) / RATE
    rows = np.arange(len(log.goals)) / log.rate
    held = np.minimum(((times + 0.5 / RATE) * log.rate).astype(int), len(rows) - 1)  # a goal comes at the nearest step
    present, load = (np.interp(times, rows, values) for values in (log.angles[:, column], loads))
    sent = np.array([servo.radians(servo.ticks(goal)) for goal in log.goals[held, column]])
    voltage = servo.motor.voltage if log.voltage is None else log.voltage
    return fit(sent, present, RATE, servo, load, voltage)


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


def fit(sent: Floats, present: Floats, rate: float, servo: Servo, carried: Pendulum | Floats, voltage: float) -> Fit:
    """Fit a servo's mechanics and its delay to recorded goals and angles, by least squares of simulated angles.

    The standard errors are those of residuals that are correlated within `CORRELATED`, and of a load that is stated wrongly: the change of
    each parameter when the weight is fitted, too.

    Args:
        sent: (N,) goals as the servo received them [rad].
        present: (N,) angles read in the same ticks [rad].
        rate: ticks a second [1/s].
        servo: gives the motor of the datasheet and the gear.
        carried: the pendulum on the shaft, or the torque (N,) of the load at each row [N m].
        voltage: of the supply, which scales the torque of the datasheet [V].

    Raises:
        ServoError: the angles are not those of the servo with this pendulum.
    """
    from scipy.optimize import least_squares

    motor, times = servo.motor, np.arange(len(sent)) / rate
    steps = round(1 / (rate * STEP))
    fine = np.arange(steps * len(sent)) * STEP

    def error(x: Floats) -> Floats:
        armature, friction, drag, gain = np.exp(x[:4])
        parameters = armature, friction, drag * motor.back_emf, gain
        path = simulated(sent, steps, servo, carried, voltage, parameters, present[0], x[5] if len(x) > 5 else 1.0)
        return np.interp(times - x[4] / rate, fine, path) - present

    found = least_squares(error, [*np.log(GUESS), 0.5], diff_step=DIFFERENCE)
    felt = least_squares(error, [*found.x, 1.0], diff_step=DIFFERENCE)
    off = float(np.abs(found.fun).mean())
    _require_good(off, float(felt.x[5]), carried)
    armature, friction, drag, gain = np.exp(found.x[:4]).tolist()
    damping = max((drag - 1) * motor.back_emf, 0.0)
    values = np.array([drag * motor.back_emf, friction, armature, gain])
    chance = _standard_errors(found.jac, found.fun, round(CORRELATED * rate))[:4]
    spread = values * np.hypot(chance, felt.x[:4] - found.x[:4])[[2, 1, 0, 3]]
    identified = Identified(round(damping, 5), round(friction, 5), round(armature, 6), round(gain, 4))
    return Fit(
        identified,
        dict(zip(FITTED, spread.tolist(), strict=True)),
        float(found.x[4]) / rate,
        off,
        voltage,
        float(felt.x[5]),
    )


def _require_good(error: float, weight: float, carried: Pendulum | Floats) -> None:
    """Check that a fit explains the angles, and that the weight that fits best is the pendulum's.

    Raises:
        ServoError: it does not.
    """
    if not isinstance(carried, Pendulum):
        if error > POOR:
            raise ServoError(
                f"no servo of this model moves so: simulated angles are {error:.4f} rad off on average, more than {POOR:g}; "
                "the limb must not touch anything and the trunk must not move, as in mode pinned"
            )
        return
    if error > POOR:
        raise ServoError(
            f"no servo of this model with this pendulum moves so: simulated angles are {error:.4f} rad off on average, more than "
            f"{POOR:g}; check --mass, --length, the model in the map, and that nothing touches the pendulum"
        )
    if not 1 / WEIGHT_FACTOR <= weight <= WEIGHT_FACTOR:
        raise ServoError(
            f"the weight that fits best is {weight:.2f} times the {carried.weight:.3g} N m of the pendulum; "
            "check that it is attached, hangs at 0 rad and has this --mass and --length"
        )


def _standard_errors(jacobian: Floats, residual: Floats, block: int) -> Floats:
    """Standard errors of a least-squares fit by the jackknife over blocks of residuals: the fit without block b is off by
    (A − J_bᵀJ_b)⁻¹ J_bᵀr_b, A = JᵀJ."""
    whole, off = jacobian.T @ jacobian, []
    for start in range(0, len(residual), block):
        part, rest = jacobian[start : start + block], residual[start : start + block]
        off.append(np.linalg.pinv(whole - part.T @ part) @ part.T @ rest)
    return np.std(off, axis=0) * np.sqrt(len(off) - 1)


def simulated(
    sent: Floats,
    steps: int,
    servo: Servo,
    carried: Pendulum | Floats,
    voltage: float,
    parameters: tuple[float, float, float, float],
    start: float,
    factor: float = 1.0,
) -> Floats:
    """Return the angles (N · steps,) of a joint whose servo gets goals (N,) [rad], each held for some steps.

    Args:
        carried: the pendulum, or the torque (N,) of the load at each goal [N m].
        factor: of the pendulum's weight, or of that torque [-].
        voltage: of the supply [V].
        parameters: armature [kg m²], friction [N m], drag [N m s/rad] and gain factor [-], at the servo's shaft.
    """
    armature, friction, drag, gain = parameters
    motor, gear = servo.motor, servo.gear
    limit = gear * motor.stall_at(voltage)
    stiffness, brake = (gear * gain * limit * duty for duty in (motor.duty_per_error(), motor.duty_per_speed()))
    hangs = isinstance(carried, Pendulum)
    inertia, weight = (carried.inertia, factor * carried.weight) if hangs else (0.0, 0.0)
    torques = itertools.repeat(0.0) if hangs else (factor * carried).tolist()
    rotor = inertia + gear**2 * armature, gear**2 * drag, gear * friction
    path, angle, speed = [], float(start), 0.0
    for goal, load in zip(sent.tolist(), torques, strict=False):
        for _ in range(steps):
            path.append(angle)
            torque = max(-limit, min(limit, stiffness * (goal - angle) - brake * speed))
            speed = next_speed(speed, torque - weight * sin(angle) - load, *rotor, STEP)
            angle += STEP * speed
    return np.array(path)
