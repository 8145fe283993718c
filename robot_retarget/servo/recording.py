"""Record a motion by hand: torque off on some joints, the others hold, poses at an even rate.

A limp joint gets no goals. At the end, on Ctrl-C and on a fault, every servo gets back the torque that it had before.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import ServoError, known
from robot_retarget.servo.bus import NoAnswerError, StatusError
from robot_retarget.servo.cycle import Cycle, Step
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import PHASES, PlaybackEnd, PlaybackOptions, PlaybackOutcome, Record
from robot_retarget.servo.performance import Performance, perform

RECORDED_RATE = 50.0
"""Poses a second [1/s]: that of ALOHA's data sets."""
FITTED = 0.18
"""Time over which cubics are fitted to the angles [s]: a swing of 0.5 rad at 1 Hz loses 0.0002 rad, measured, and the rounding of
the encoder leaves an acceleration of 0.4 rad/s²; with half 1.5 rad/s² (3.8 without), with double the swing loses 0.003 rad."""


@dataclass(frozen=True)
class HandTake:
    """Poses of a recording."""

    angles: Floats
    """(N, n) [rad], a column for each joint of the map."""
    rate: float
    """Poses a second [1/s]."""

    def smoothed(self, span: float = FITTED) -> "HandTake":
        """Return the take with each angle replaced by that of a cubic through the angles of `span` around it [s]."""
        from scipy.signal import savgol_filter

        window = 2 * round(span * self.rate / 2) + 1
        if window <= 3 or len(self.angles) < window:
            return self
        return replace(self, angles=savgol_filter(self.angles, window, 3, axis=0))


def limp_joints(servo_map: ServoMap, names: Sequence[str], limbs: dict[str, tuple[str, ...]]) -> list[str]:
    """Return the joints of a map that some names mean: limbs (`left_arm`, `l_arm`), joints and patterns (`l_*`).

    Raises:
        ServoError: A name means no joint of the map.
    """
    found: set[str] = set()
    for name in names:
        side, _, part = name.partition("_")
        limb = limbs.get(name) or limbs.get(f"{ {'l': 'left', 'r': 'right'}.get(side, side) }_{part}", ())
        means = {joint for joint in servo_map.joints if joint in limb or fnmatchcase(joint, name)}
        if not means:
            raise ServoError(f"no joint and no limb {name!r}; {known([*limbs, *servo_map.joints], 40, typed=name)}")
        found |= means
    return [joint for joint in servo_map.joints if joint in found]


def record(
    servo_map: ServoMap,
    port: str | Path,
    limp: Sequence[str],
    seconds: float | None = None,
    countdown: int = 3,
    options: PlaybackOptions | None = None,
    log: str | Path | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> tuple[HandTake, PlaybackOutcome]:
    """Record the poses of a robot that is moved by hand.

    Args:
        servo_map: the robot's servos.
        port: a serial port, or that of an emulator.
        limp: joints whose torque is switched off after the countdown; the others hold.
        seconds: duration of the take; by default until Ctrl-C or the space bar [s].
        countdown: seconds between the torque of all joints and the take [s].
        options: as for `play`.
        log: where the log of every tick goes (`play.npz`), however the recording ends.
        say: receives progress messages.

    Returns:
        The take, which may be empty, and the end of the recording; Ctrl-C is a good end.

    Raises:
        ServoError: as `play`.
    """
    kept = Record(servo_map.joints)
    chosen = np.array([joint in limp for joint in servo_map.joints])

    def act(performance: Performance) -> PlaybackOutcome:
        before = [0] * len(servo_map.servos)

        def take(cycle: Cycle) -> str:
            try:
                _take(performance, cycle, chosen, countdown, seconds)
            finally:
                _restore(performance.link, before)
            return f"recorded; {performance.ending}"

        for k, servo in enumerate(servo_map.servos):
            with suppress(NoAnswerError, StatusError):
                before[k] = performance.bus.value(servo.id, servo.type.registers["torque_enable"])
        performance.ending = f"torque is as before: on in {sum(before)} of {len(before)} servos"
        return performance.run(take)

    how = options or PlaybackOptions(grace=0.0)
    outcome, found = perform(servo_map, port, RECORDED_RATE, how, kept, log, say, act), _even(kept)
    if outcome.ended is PlaybackEnd.INTERRUPTED and outcome.reason.startswith("interrupted,") and len(found.angles):
        reason = outcome.reason.replace("interrupted", "ended by hand")
        outcome = replace(outcome, ended=PlaybackEnd.FINISHED, reason=reason)
    return found, outcome


def _take(performance: Performance, cycle: Cycle, limp: np.ndarray, countdown: int, seconds: float | None) -> None:
    """Count down with torque on everywhere, let the limp joints go, and read poses."""
    goal, link = cycle.guard.goal.copy(), cycle.link
    names = ", ".join(joint for joint, off in zip(link.map.joints, limp, strict=True) if off)
    for left in range(countdown, 0, -1):
        performance.say(f"{left}: support {names}" if left == countdown else str(left))
        performance.run_ticks(cycle, lambda k: Step(goal, "hold", goal), lambda: RECORDED_RATE - 1)
    link.limp = limp
    for k in np.flatnonzero(limp):
        servo = link.map.servos[k]
        link.bus.write(servo.id, servo.type.registers["torque_enable"], 0)
        link.torque[k] = False
    performance.say("recording; Ctrl-C or the space bar ends the take")
    ended: list[int] = []

    def step(k: int) -> Step | None:
        target = np.where(limp, link.present, goal)
        return None if ended else Step(target, "play", target)

    def stop(k: int) -> bool:
        ended.append(k)
        return True

    last = np.inf if seconds is None else round(seconds * RECORDED_RATE)
    performance.run_ticks(cycle, step, lambda: float(last), stop)


def _restore(link: Link, before: Sequence[int]) -> None:
    """Switch the torque of every servo to its state before; servos that regain torque hold their present angle."""
    link.limp = np.zeros(len(link.ids), dtype=bool)
    goals = link.goals(link.present)
    for k, (servo, on) in enumerate(zip(link.map.servos, before, strict=True)):
        with suppress(NoAnswerError, StatusError):
            if on and not link.torque[k]:
                link.write_verified(goals, k)
            link.bus.write(servo.id, servo.type.registers["torque_enable"], on)
            link.torque[k] = bool(on)


def _even(kept: Record) -> HandTake:
    """Return the poses of a record at even times; a lost reading is interpolated."""
    playing: Ints = np.flatnonzero(kept.column("phase") == PHASES.index("play"))
    if playing.size < 2:
        return HandTake(np.zeros((0, len(kept.joints))), RECORDED_RATE)
    times, present, age = (kept.column(name)[playing] for name in ("time", "present", "age"))
    even = np.arange(times[0], times[-1] + 0.5 / RECORDED_RATE, 1 / RECORDED_RATE)
    fresh = [age[:, k] == 0 for k in range(len(kept.joints))]
    columns = [
        np.interp(even, times[on], present[on, k]) if on.any() else np.full(len(even), present[0, k])
        for k, on in enumerate(fresh)
    ]
    return HandTake(np.stack(columns, axis=1), RECORDED_RATE)
