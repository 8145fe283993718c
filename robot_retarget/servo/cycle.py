"""The exchange of one tick: send goals and a read request, receive readings, check and record them."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.map import Limits
from robot_retarget.base.arrays import Floats
from robot_retarget.servo.check import hardware_errors
from robot_retarget.servo.link import JointScale, Link, ServoGoals
from robot_retarget.servo.outcome import PHASES, FaultError, HeatError, Record

# Limit goals: joint range, speed, and distance from the present angle.


@dataclass
class Guard:
    """Holds goals to the limits: joint range, speed since the last goal, distance from the present angle."""

    scale: JointScale
    limits: Limits
    goal: Floats
    """(n,) the last goal [rad]."""
    clear: Callable[[Floats, Floats], Floats] | None = None
    """Self-collision guard from a layer with the robot's geometry: (last goal, goal) → goal, (n,) each [rad]."""
    limited: NDArray[np.int64] = field(init=False)
    """(n,) number of limited targets per joint."""
    capped_for: Floats = field(init=False)
    """(n,) time since which the distance from the present angle has limited each goal without a break [s]."""

    def __post_init__(self) -> None:
        self.limited = np.zeros(len(self.goal), dtype=np.int64)
        self.capped_for = np.zeros(len(self.goal))

    def aim(self, target: Floats, dt: float) -> Floats:
        """Return a target limited by range and speed, before the next reading.

        A target that is not a number keeps the last goal.
        """
        wanted = np.where(np.isfinite(target), target, self.goal)
        reach = self.limits.speed * dt
        goal = _between(self.goal - reach, wanted, self.goal + reach)
        goal = _between(self.scale.lower, goal, self.scale.upper)
        return goal if self.clear is None else self.clear(self.goal, goal)

    def admit(self, aim: Floats, present: Floats) -> Floats:
        """Return the nearest goal within the step cap of the joints; the same array if no joint is limited."""
        # A tick of rounding must not carry a goal over the cap.
        cap = self.limits.jump - self.scale.tick
        if (np.abs(aim - present) <= cap).all():
            return aim
        return _between(self.scale.lower, _between(present - cap, aim, present + cap), self.scale.upper)

    def record(self, goal: Floats, target: Floats, aim: Floats, dt: float) -> None:
        """Record a goal (n,) sent for a target `target` and its limited form `aim` [rad], `dt` after the last [s]."""
        self.limited += np.abs(goal - target) > 1e-9
        self.capped_for = np.where(np.abs(goal - aim) > 1e-9, self.capped_for + dt, 0.0)
        self.goal = goal


def _between(low: Floats, value: Floats, high: Floats) -> Floats:
    """As `np.clip`, at a third of its time: between two exchanges every microsecond counts."""
    return np.minimum(np.maximum(value, low), high)


# Check readings of the servos against the limits of the map during playback.

MISSES = 2
"""Number of ticks in a row without an answer that counts as silence: one may be lost to a disturbed line, once in 100 ticks."""
OVERLOADED = 0.5
"""Longest time above the current limit [s], as `Limits.current` states."""
STUCK = 0.3
"""A joint whose goal the step cap limits for this long does not follow [s]: 3 times that in which an XM430, at the 4.8
rad/s of its data sheet, comes from `Limits.jump` to its goal."""
ALERTED = 0x80
"""The bit of `Link.error` for a pending hardware error."""


class Judge:
    """Checks the latest readings of a link."""

    def __init__(self, link: Link) -> None:
        self.link, self.limits = link, link.map.limits
        self._high_since: float | None = None
        self.heat_known: bool = False
        """Whether overheating is handled: the player moves into a stand, and heat is no fault any more."""

    def judge(self, now: float, capped_for: Floats) -> None:
        """Check everything that can go wrong during playback.

        Args:
            now: time of the tick [s].
            capped_for: (n,) time for which the step cap has limited each goal [s].

        Raises:
            FaultError: playback cannot continue.
        """
        if self.link.error.any():
            self._alerts()
        if self.link.missed.any():
            self._silence()
        self._state()
        self._supply()
        self._heat()
        self._strain(now)
        self._stuck(capped_for)

    def require_fresh(self) -> None:
        """Read every servo until none of the readings is old.

        Raises:
            FaultError: a servo does not answer.
        """
        for _ in range(20):
            self.link.read()
            if not self.link.missed.any():
                return
        raise FaultError(f"{self._names(self.link.missed > 0)} does not answer")

    def _alerts(self) -> None:
        alerted = np.flatnonzero(self.link.error & ALERTED)
        if alerted.size:
            k = int(alerted[0])
            self._hardware(k, self.link.hardware_bits(k))

    def _state(self) -> None:
        if not (self.link.torque | self.link.limp).all():
            self.link.read_state(range(len(self.link.ids)))
            limp = self._names(~self.link.torque & ~self.link.limp)
            raise FaultError(f"torque is off on {limp}: restarted (power), or switched off by another program")
        failed = np.flatnonzero(self.link.hardware)
        if failed.size:
            self._hardware(int(failed[0]), int(self.link.hardware[failed[0]]))

    def _hardware(self, k: int, bits: int) -> None:
        servo = self.link.map.servos[k]
        raise FaultError(f"{servo.joint} (servo {servo.id}): hardware error: {hardware_errors(bits, servo)}")

    def _stuck(self, capped_for: Floats) -> None:
        stuck = (capped_for > STUCK) & ~self.link.limp
        if stuck.any():
            raise FaultError(
                f"{self._names(stuck)} does not follow: {self.limits.jump:g} rad from its goal for {STUCK:g} s "
                f"(jammed, overloaded, or without power)"
            )

    def _silence(self) -> None:
        missing = self.link.missed >= MISSES
        silent = missing & (self.link.age >= self.limits.silence)
        if silent.any() and missing.all():  # who answered a moment longer than the first is gone with it all the same
            raise FaultError("no servo answers any more (power, cable)")
        if silent.any():
            raise FaultError(f"{self._names(silent)} no longer answers")

    def _supply(self) -> None:
        low, high = self.link.voltage.min(), self.link.voltage.max()
        if low < self.limits.min_voltage or high > self.limits.max_voltage:
            raise FaultError(f"supply is {low if low < self.limits.min_voltage else high:.1f} V")

    def _heat(self) -> None:
        hot = self.link.temperature >= self.limits.temperature
        if hot.any() and not self.heat_known:
            raise HeatError(f"{self._names(hot)} is {self.link.temperature[hot].max():.0f} °C hot")

    def _strain(self, now: float) -> None:
        current = np.abs(self.link.current)
        strained = current > self.limits.current
        if not strained.any():
            self._high_since = None
        elif self._high_since is None:
            self._high_since = now
        elif now - self._high_since > OVERLOADED:
            raise FaultError(f"{self._names(strained)} draws {current.max():.1f} A")

    def _names(self, which: np.ndarray) -> str:
        servos = zip(self.link.map.servos, which, strict=True)
        return ", ".join(f"{servo.joint} (servo {servo.id})" for servo, yes in servos if yes)


SPARE_TIME = 1.5e-3
"""With at least this much of a tick left, slow registers are read at a rate that covers all servos in ROUND [s]."""
ROUND = 0.1
"""With less time left, the slow registers of one servo are read in each interval of this length [s]."""


class PreparedGoals(NamedTuple):
    """Prepared goals of the next tick, valid if the joints are near them by then."""

    target: Floats
    aim: Floats
    goals: ServoGoals


class Step(NamedTuple):
    """Target of a tick."""

    target: Floats
    """(n,) [rad]."""
    phase: str
    following: Floats
    """(n,) expected target of the next tick [rad]."""
    motion: Floats | None = None
    """(n,) angles that the joints should have at this tick, which goals that compensate lag lead [rad]; None: `target`."""


class Cycle:
    """The ticks of one performance.

    At a rate near the limit of the bus, only the distance of goals from joints is checked between the readings and the next
    goals. The next goals are prepared, and the last tick is judged and recorded, while the answers are on the wire. If time
    is left, a tick is finished at once.
    """

    def __init__(
        self, link: Link, guard: Guard, judge: Judge, record: Record, began: float, lockstep: bool = False
    ) -> None:
        self.link, self.guard, self.judge, self.record = link, guard, judge, record
        self._began, self._sensed, self._lockstep = began, 0.0, lockstep
        self._open: dict[str, Any] | None = None
        self._ahead: PreparedGoals | None = None

    def tick(self, step: Step, period: float, due: float) -> None:
        """Move towards the target of a step.

        Args:
            period: To the next tick [s].
            due: When the tick is due on the monotonic clock [s].

        Raises:
            FaultError: a fault stops playback.
            PortLostError: the port is gone.
        """
        began = due if self._lockstep else time.monotonic()
        goal = self._send(step.target, period)
        self.finish()
        self._open = {"time": began - self._began, "phase": PHASES.index(step.phase), "late": began - due}
        self._open |= {"goal": goal, "plan": step.target, "motion": step.target if step.motion is None else step.motion}
        self._ahead = self._prepared(step.following, period)
        self.link.listen()
        now = due if self._lockstep else time.monotonic()
        self._open["busy"] = now - began
        if due + period - now > SPARE_TIME:
            self._sense(ceil(2 * len(goal) * period / ROUND))
            self.finish()
        elif now - self._sensed > ROUND:
            self._sense(1)

    def _send(self, target: Floats, period: float) -> Floats:
        """Send the goals of a target: the prepared ones where the joints are near them."""
        ahead = self._ahead
        if ahead is None or ahead.target is not target:
            ahead = self._prepared(target, period)
        goal = self.guard.admit(ahead.aim, self.link.present)
        self.link.exchange(ahead.goals if goal is ahead.aim else self.link.goals(goal))
        self.guard.record(goal, target, ahead.aim, period)
        return goal

    def _sense(self, count: int) -> None:
        self._sensed = time.monotonic()
        self.link.read_slow_registers(count)

    def _prepared(self, target: Floats, period: float) -> PreparedGoals:
        aim = self.guard.aim(target, period)
        return PreparedGoals(target, aim, self.link.goals(aim))

    def finish(self) -> None:
        """Record and check the last tick, if that is still to do.

        Raises:
            FaultError: a fault stops playback.
        """
        began = self.account()
        if began is not None:
            self.judge.judge(began, self.guard.capped_for)

    def account(self) -> float | None:
        """Record the last tick. Returns its time [s], or None if it is recorded already."""
        row, link, self._open = self._open, self.link, None
        if row is None:
            return None
        self.record.add(
            **{"busy": 0.0} | row, present=link.present, velocity=link.velocity, current=link.current,
            age=link.age, error=link.error, voltage=link.voltage, temperature=link.temperature,
        )  # fmt: skip
        return float(row["time"])
