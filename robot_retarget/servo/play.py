"""Play a trajectory on servos: check, take hold, approach, play, end softly, and stop rightly whatever happens."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import ServoError
from robot_retarget.servo.bus import Bus, NoAnswerError, PortLostError, StatusError, slow_adapter
from robot_retarget.servo.check import Condition, Finding, check, hardware_errors
from robot_retarget.servo.clock import on_time, wait_until
from robot_retarget.servo.guard import Guard, Scale
from robot_retarget.servo.link import Link
from robot_retarget.servo.map import ServoMap
from robot_retarget.servo.outcome import Ended, Options, Outcome
from robot_retarget.servo.plan import Plan, glide
from robot_retarget.servo.record import PHASES, Record
from robot_retarget.servo.tables import XM430_W350

MISSES = 5
"""So many ticks without an answer are forgiven at any rate."""
SPARE = 1.5e-3
"""With so much of a tick left, voltage and temperature of one servo are read [s]; without, only every SENSE_PERIOD."""
SENSE_PERIOD = 0.1
"""[s]."""
OVERLOADED = 0.5
"""Too high a current is forgiven for so long [s]."""


class _FaultError(Exception):
    """Playing cannot go on."""


class _InterruptError(Exception):
    """Somebody asked to stop."""


@dataclass
class Player:
    """One performance on an open bus. `play` runs it."""

    bus: Bus
    map: ServoMap
    options: Options
    record: Record
    say: Callable[[str], None] = lambda text: None
    warnings: list[str] = field(default_factory=list)
    interrupts: int = 0
    """How often somebody asked to stop."""
    terminated: bool = False

    def __post_init__(self) -> None:
        self._began = time.monotonic()
        self._high_since: float | None = None
        self._sensed = 0.0
        self._open: dict[str, Any] | None = None

    def play(self, plan: Plan) -> Outcome:
        """Check, engage, approach, play, end.

        Raises:
            ServoError: the robot is not fit to be moved; nothing was moved.
        """
        conditions = self.examine()
        with self._signals(), on_time():
            try:
                self.link = Link(self.bus, self.map, conditions)
                self.link.fast &= self.options.fast
                self.guard = self.engage(self.link)
                reason = self._perform(plan)
                return self._leave(Ended.FINISHED, reason, self.options.release)
            except PortLostError as error:
                return self._gone(str(error))
            except _InterruptError:
                return self._hold()
            except (_FaultError, NoAnswerError, StatusError) as error:
                return self._stop(str(error))

    def examine(self) -> list[Condition]:
        """Read everything about all servos.

        Raises:
            ServoError: something grave is wrong; all of it is said.
        """
        conditions, findings = check(self.bus, self.map)
        self.warnings += [str(f) for f in findings if not f.grave]
        grave = [f for f in findings if f.grave]
        if grave:
            raise ServoError(_refusal(grave))
        return conditions

    def engage(self, link: Link) -> Guard:
        """Goal := present, then torque, servo by servo; nothing moves. Servos with torque on keep it."""
        self.say("taking hold")
        link.set_all("bus_watchdog", 0)
        self._fresh(link)
        link.command(link.present)
        for name in ("profile_acceleration", "profile_velocity"):
            link.set_all(name, 0)
        for servo, here in zip(self.map.servos, link.present, strict=True):
            registers = servo.type.registers
            low, high = servo.tick_range
            goal = min(max(servo.ticks(float(here)), low), high)
            self.bus.write(servo.id, registers["goal_position"], goal)
            if self.bus.value(servo.id, registers["goal_position"]) != goal:
                raise _FaultError(f"{servo.joint} does not keep its goal")
            self.bus.write(servo.id, registers["torque_enable"], 1)
        link.watchdog(self.map.limits.watchdog)
        self._fresh(link)
        return Guard(link.scale, self.map.limits, np.clip(link.present, link.scale.lower, link.scale.upper))

    def _perform(self, plan: Plan) -> str:
        limits, rate = self.map.limits, self.options.rate
        way = glide(self.guard.goal, plan.at(0.0), rate, limits)
        self.say(f"approaching the first frame in {way.duration:.1f} s")
        self._follow(way, "approach")
        self.say(f"playing {plan.duration:.1f} s")
        self._follow(plan, "play")
        if self.options.end_pose and self.map.stop.pose:
            pose = np.array(
                [self.map.stop.pose.get(j, a) for j, a in zip(self.map.joints, self.guard.goal, strict=True)]
            )
            self.say("going to the stop pose")
            self._follow(glide(self.guard.goal, pose, rate, limits), "end")
        return Ended.FINISHED.value

    def _follow(self, plan: Plan, phase: str) -> None:
        """Ticks on an even clock until the plan is over."""
        period, began = 1 / self.options.rate, time.monotonic()
        last, k, count = began, 0, round(plan.duration * self.options.rate)
        while k <= count:
            due = began + k * period
            now = wait_until(due)
            if now - last > self.map.limits.watchdog > 0:
                raise _FaultError(f"this computer paused for {now - last:.2f} s; the servos stopped themselves")
            last = now
            self._tick(plan.at(k * period), period, phase, due)
            if self.interrupts:
                raise _InterruptError
            # A tick that ran over the time of others takes their place: the motion keeps its own time.
            following = min(max(k + 1, int((time.monotonic() - began) / period)), max(count, k + 1))
            self.record.skipped += following - k - 1
            k = following
        self._account()

    def _tick(self, wish: Floats, period: float, phase: str, due: float) -> None:
        """One exchange: goals and a request out, readings in and judged. The last tick is written down meanwhile."""
        link, began = self.link, time.monotonic()
        goal = self.guard.admit(wish, link.present, period)
        link.ask(goal)
        self._account()
        self._open = {"time": began - self._began, "phase": PHASES.index(phase), "late": began - due}
        self._open |= {"goal": goal, "plan": wish, "busy": 0.0}
        link.listen()
        now = time.monotonic()
        self._open["busy"] = now - began
        if due + period - now > SPARE or now - self._sensed > SENSE_PERIOD:
            self._sensed = now
            link.sense()
        self._judge()

    def _account(self) -> None:
        """Write the last tick down, if that is not done yet."""
        if self._open is not None:
            row, link, self._open = self._open, self.link, None
            self.record.add(
                **row, present=link.present, velocity=link.velocity, current=link.current,
                age=link.age, error=link.error, voltage=link.voltage, temperature=link.temperature,
            )  # fmt: skip

    def _judge(self) -> None:
        """Whether playing may go on.

        Raises:
            _FaultError: it must not.
        """
        link, limits = self.link, self.map.limits
        if link.error.any() and (link.error & 0x80).any():
            raise _FaultError(self._alert(int(np.argmax(link.error & 0x80))))
        if link.missed.any():
            silent = (link.missed >= MISSES) & (link.age >= limits.silence)
            if silent.all():
                raise _FaultError("no servo answers any more (power, cable)")
            if silent.any():
                raise _FaultError(f"{self._names(silent)} no longer answers")
        low, high = link.voltage.min(), link.voltage.max()
        if low < limits.min_voltage or high > limits.max_voltage:
            raise _FaultError(f"supply is {low if low < limits.min_voltage else high:.1f} V")
        if (hot := link.temperature >= limits.temperature).any():
            raise _FaultError(f"{self._names(hot)} is {link.temperature[hot].max():.0f} °C hot")
        strained = np.abs(link.current) > limits.current
        if not strained.any():
            self._high_since = None
        elif self._high_since is None:
            self._high_since = time.monotonic()
        elif time.monotonic() - self._high_since > OVERLOADED:
            raise _FaultError(f"{self._names(strained)} draws {np.abs(link.current).max():.1f} A")

    def _alert(self, k: int) -> str:
        servo = self.map.servos[k]
        bits = self.bus.value(servo.id, XM430_W350["hardware_error_status"])
        return f"{servo.joint} (servo {servo.id}): hardware error: {hardware_errors(bits)}"

    def _names(self, which: np.ndarray) -> str:
        return ", ".join(f"{s.joint} (servo {s.id})" for s, yes in zip(self.map.servos, which, strict=True) if yes)

    def _fresh(self, link: Link) -> None:
        """Readings of every servo, none of them old."""
        for _ in range(20):
            link.read()
            if not link.missed.any():
                return
        raise _FaultError(f"{self._names(link.missed > 0)} does not answer")

    # Endings

    def _leave(self, ended: Ended, reason: str, release: bool = False) -> Outcome:
        """Let the servos keep their goals without us, or let go."""
        try:
            self._settle()
            if release:
                self._let_go()
        except PortLostError as error:
            return self._gone(str(error))
        return self._outcome(ended, "release" if release else "hold", reason)

    def _let_go(self) -> None:
        """Torque off: all at once, then each with an answer, as far as they answer."""
        self.link.set_all("torque_enable", 0)
        for servo in self.map.servos:
            with suppress(NoAnswerError, StatusError):
                self.bus.write(servo.id, servo.type.registers["torque_enable"], 0)

    def _settle(self) -> None:
        """Switch the watchdog off three times over, as nobody answers; goals of servos that had stopped start anew."""
        for _ in range(3):
            self.link.set_all("bus_watchdog", 0)
        if hasattr(self, "guard"):
            present = self.link.present
            reach = self.map.limits.jump
            self.link.command(np.where(np.abs(self.guard.goal - present) > reach, present, self.guard.goal))

    def _stop(self, reason: str) -> Outcome:
        """Something is wrong: everybody holds where the last goal was."""
        return self._leave(Ended.FAULT, reason)

    def _hold(self) -> Outcome:
        """Ctrl-C: hold under watch for a while; a second one lets go."""
        if self.terminated:
            return self._leave(Ended.INTERRUPTED, "terminated, holding")
        self.say(f"holding; Ctrl-C within {self.options.grace:g} s lets go")
        period, until, asked = 1 / self.options.rate, time.monotonic() + self.options.grace, self.interrupts
        try:
            goal, due = self.guard.goal.copy(), time.monotonic()
            while time.monotonic() < until and self.interrupts == asked and not self.terminated:
                wait_until(due)
                self._tick(goal, period, "hold", due)
                due += period
        except PortLostError as error:
            return self._gone(str(error))
        except (_FaultError, NoAnswerError, StatusError) as error:
            return self._stop(str(error))
        if self.interrupts > asked:
            return self._leave(Ended.INTERRUPTED, "interrupted twice, let go", release=True)
        return self._leave(Ended.INTERRUPTED, "interrupted, holding")

    def _gone(self, reason: str) -> Outcome:
        watchdog = self.map.limits.watchdog
        after = f"; the servos stop by themselves after {1000 * watchdog:.0f} ms" if watchdog else ""
        return self._outcome(Ended.LOST, "watchdog", reason + after)

    def _outcome(self, ended: Ended, state: str, reason: str) -> Outcome:
        self._account()
        self.record.note(time.monotonic() - self._began, f"{ended.name.lower()}: {reason}; {state}")
        figures = self.record.summary()
        if hasattr(self, "guard"):
            held = self.guard.held_back
            figures["held_back"] = {j: int(n) for j, n in zip(self.map.joints, held, strict=True) if n}
        return Outcome(ended, state, reason, figures, tuple(self.warnings))

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """Count interrupts instead of dying of them; SIGTERM holds and leaves."""

        def count(number: int, frame: FrameType | None) -> None:
            del frame
            self.interrupts += 1
            self.terminated |= number == signal.SIGTERM

        before = {number: signal.signal(number, count) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def play(
    plan: Plan,
    servo_map: ServoMap,
    port: str | Path,
    options: Options | None = None,
    log: str | Path | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Play a plan on the servos of a map.

    Args:
        plan: what `make_plan` made of a trajectory.
        servo_map: the robot's servos.
        port: a serial port, or that of an emulator.
        options: rate and endings.
        log: where `play.npz` goes; written however playing ends.
        say: is told what is being done.

    Raises:
        ServoError: the port cannot be opened or is too slow, or the robot is not fit to be moved.
    """
    slow = slow_adapter(port)
    if slow is not None:
        raise ServoError(slow)
    record = Record(servo_map.joints)
    try:
        with Bus(port, servo_map.baud) as bus:
            return Player(bus, servo_map, options or Options(), record, say).play(plan)
    finally:
        if log is not None:
            record.save(log)


def rehearse(plan: Plan, servo_map: ServoMap, port: str | Path | None = None) -> dict[str, Any]:
    """What playing would ask of the servos; with a port, the robot is examined, too. Nothing moves.

    Raises:
        ServoError: as `play`.
    """
    scale = Scale(servo_map)
    outside = np.maximum(plan.angles - scale.upper, scale.lower - plan.angles).max(axis=0)
    facts: dict[str, Any] = {
        "duration_s": round(plan.duration, 3),
        "top_speed_rad_s": round(plan.top_speed, 3),
        "speed_limit_rad_s": servo_map.limits.speed,
        "clipped_rad": {j: round(float(x), 4) for j, x in zip(servo_map.joints, outside, strict=True) if x > 1e-9},
    }
    if port is not None:
        with Bus(port, servo_map.baud) as bus:
            player = Player(bus, servo_map, Options(), Record(servo_map.joints))
            here = np.array([condition.angle for condition in player.examine()])
        way = glide(here, plan.at(0.0), 100.0, servo_map.limits)
        facts |= {"approach_s": round(way.duration, 2), "warnings": player.warnings}
    return facts


def _refusal(findings: list[Finding]) -> str:
    listed = "; ".join(map(str, findings[:6]))
    return f"not fit to be moved: {listed}" + (f"; and {len(findings) - 6} more" if len(findings) > 6 else "")
