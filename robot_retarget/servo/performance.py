"""A performance on servos: check, engage, act tick by tick, end; stop safely on any fault."""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus, NoAnswerError, PortLostError, StatusError, slow_adapter
from robot_retarget.servo.check import require_fit
from robot_retarget.servo.cycle import Cycle, Guard, Judge, Step
from robot_retarget.servo.host import Interrupts, real_time, wait_until, without_sleep_states
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import FaultError, HeatError, PlaybackEnd, PlaybackOptions, PlaybackOutcome, Record
from robot_retarget.servo.plan import Course, ServoPlan, glide
from robot_retarget.servo.watch import FallGuard

# Engage a robot without a jump, leave it holding, release it.

STRAIN = 0.15
"""A servo left holding is not left pulling at more than this [rad]: two thirds of the 0.217 rad of full duty at the usual
gain."""


def take_hold(link: Link, judge: Judge) -> Guard:
    """Goal := present, a gain of the map, then torque, servo by servo; nothing moves. Servos with torque on keep it.

    Raises:
        FaultError: a servo does not answer, is outside its range, or does not keep its goal.
    """
    link.set_all("bus_watchdog", 0)
    judge.require_fresh()
    link.command(link.present)
    for name in ("profile_acceleration", "profile_velocity"):
        link.set_all(name, 0)
    goals = link.goals(link.present)
    for k, servo in enumerate(link.map.servos):
        if not link.write_verified(goals, k):
            raise FaultError(f"{servo.joint} does not keep its goal")
        if servo.p_gain:
            link.bus.write(servo.id, servo.type.registers["position_p_gain"], servo.p_gain)
        link.bus.write(servo.id, servo.type.registers["torque_enable"], 1)
        link.torque[k] = True
    link.watchdog(link.map.watchdog)
    judge.require_fresh()
    return Guard(link.scale, link.map.limits, np.clip(link.present, link.scale.lower, link.scale.upper))


def leave_holding(link: Link, goal: Floats | None) -> None:
    """Switch the watchdog off, three times as no servo confirms it; move goals that are far from their joints to them.

    Servos without torque get no goal: under Protocol 1 it would switch their torque on.
    """
    for _ in range(3):
        link.set_all("bus_watchdog", 0)
    if goal is not None:
        link.command(np.where(np.abs(goal - link.present) <= STRAIN, goal, link.present), link.torque)


def let_go(link: Link) -> None:
    """Torque off: all at once, then each with an answer, as far as they answer."""
    link.set_all("torque_enable", 0)
    for servo in link.map.servos:
        with suppress(NoAnswerError, StatusError):
            link.bus.write(servo.id, servo.type.registers["torque_enable"], 0)


STOPPING = (FaultError, NoAnswerError, StatusError)
"""Errors that end a motion with all servos holding."""
MADE_UP = 0.025
"""Ticks up to this late are sent at once, one after the other; later ones are skipped [s]: three ticks of the 8 ms of `goals.RATE`. The motion
keeps its mean speed."""


class _InterruptError(Exception):
    """Somebody asked to stop."""


class Performance:
    """Ticks on an open bus, between engaging the servos and leaving them safely."""

    link: Link
    guard: Guard | None = None
    cycle: Cycle | None = None

    def __init__(
        self,
        bus: Bus,
        servo_map: ServoMap,
        rate: float,
        options: PlaybackOptions,
        record: Record,
        say: Callable[[str], None],
    ) -> None:
        self.bus, self.map, self.options, self.record, self.say = bus, servo_map, options, record, say
        self.warnings: list[str] = []
        self.interrupts: Interrupts = Interrupts()
        self._began = self._due = time.monotonic()
        self._rate = rate
        self._heeded = 0
        """Interrupts after which a motion went on into a stand."""
        self._heat = ""
        """The heat after which it did."""
        self.ending = "standing"
        """How a motion that was asked to stop, or that found a hot servo, ends."""

    @property
    def stood(self) -> bool:
        """Whether the motion went into a stand before its end."""
        return bool(self._heeded or self._heat)

    def note_fault(self, text: str) -> None:
        """Record and report a fault that does not stop the motion."""
        self.warnings.append(text)
        self.record.note(self._now() - self._began, text)
        self.say(text)

    def run(self, act: Callable[[Cycle], str]) -> PlaybackOutcome:
        """Check, engage, act, and end safely; `act` returns the reason of the end.

        Raises:
            ServoError: the robot is not fit to be moved; nothing was moved.
        """
        conditions, notes = require_fit(self.bus, self.map)
        self.warnings += notes
        with self.interrupts.listening(), real_time(), without_sleep_states():
            try:
                self.link = Link(self.bus, self.map, conditions, self._now)
                self.link.fast &= self.options.fast
                self.say("taking hold")
                judge = Judge(self.link)
                self.guard = take_hold(self.link, judge)
                self.cycle = Cycle(self.link, self.guard, judge, self.record, self._began, self.options.lockstep)
                reason = act(self.cycle)
                if self._heat:
                    return self._leave(PlaybackEnd.FAULT, f"{self._heat}; {self.ending}")
                if self._heeded:
                    return self._leave(PlaybackEnd.INTERRUPTED, f"interrupted, {self.ending}")
                return self._leave(PlaybackEnd.FINISHED, reason, self.options.release)
            except PortLostError as error:
                return self._gone(str(error))
            except _InterruptError:
                return self._hold()
            except STOPPING as error:
                return self._leave(PlaybackEnd.FAULT, str(error))

    def move_to_stop_pose(self, cycle: Cycle, watch: FallGuard | None = None) -> None:
        """Move to the map's stop pose, if it has one and the options allow it."""
        if self.options.end_pose and self.map.stop.pose:
            here = zip(self.map.joints, cycle.guard.goal, strict=True)
            pose = np.array([self.map.stop.pose.get(joint, angle) for joint, angle in here])
            self.say("going to the stop pose")
            self.follow(cycle, glide(cycle.guard.goal, pose, self._rate, self.map.limits), "end", watch)

    def follow(
        self,
        cycle: Cycle,
        plan: ServoPlan,
        phase: str,
        watch: FallGuard | None = None,
        ways: Sequence[ServoPlan] = (),
    ) -> None:
        """Make the ticks of a plan, or of the way out of it that is taken on a request to stop."""
        course = Course(plan, ways)

        def step(k: int) -> Step:
            if course.reach(k) and watch is not None:
                watch.follow(course.plan)
            target, motion = course.target(k), course.plan.motion
            if watch is not None:
                target = watch.goal(k, target) if phase == "play" else watch.listen(target)
            return Step(target, phase, course.target(k + 1), None if motion is None else motion[k])

        def stop(k: int) -> bool:
            leads = course.stop(k)
            if leads:
                self.say(f"going into a stand within {course.remaining(k):.1f} s; Ctrl-C holds at once")
            return leads

        self.run_ticks(cycle, step, lambda: course.last, stop)

    def run_ticks(
        self,
        cycle: Cycle,
        step: Callable[[int], Step | None],
        final: Callable[[], float] = lambda: math.inf,
        stop: Callable[[int], bool] = lambda k: False,
    ) -> None:
        """Make ticks on an even clock until `step` returns None or the final tick is made.

        Ticks that are too late are skipped (`ticks_to_skip`); the final one is not.

        Args:
            cycle: exchanges with the servos.
            step: gives the step of a tick.
            final: gives the last tick.
            stop: called with a tick when somebody asks to stop, or a servo is hot; whether the steps after it lead into a stand.
        """
        period, began = 1 / self._rate, self._now()
        last, k = began, 0
        while k <= final():
            due = began + k * period
            now = self._wait(due)
            if now - last > self.map.watchdog > 0:
                raise FaultError(f"this computer paused for {now - last:.2f} s; the servos stopped themselves")
            last, made = now, step(k)
            if made is None:
                break
            try:
                cycle.tick(made, period, due)
            except HeatError as fault:
                if not stop(k):
                    raise
                self._heat, cycle.judge.heat_known = str(fault), True
            if self.interrupts.requests > self._heeded:
                if self.interrupts.terminated or not stop(k):
                    raise _InterruptError
                self._heeded = self.interrupts.count
            self._due = due + period
            late = 0.0 if self.options.lockstep else time.monotonic() - due
            left_out = int(min(ticks_to_skip(late, period), max(0, final() - k - 1)))
            self.record.skipped += left_out
            k += 1 + left_out
        cycle.finish()

    def _now(self) -> float:
        """Return the time [s]: in lockstep that of the ticks."""
        return self._due if self.options.lockstep else time.monotonic()

    def _wait(self, due: float) -> float:
        """Wait for a tick; return the time after it [s]."""
        self._due = due
        return due if self.options.lockstep else wait_until(due)

    # Endings

    def _leave(self, ended: PlaybackEnd, reason: str, release: bool = False) -> PlaybackOutcome:
        """Leave the servos holding their goals, or release them."""
        try:
            leave_holding(self.link, self.guard.goal if self.guard else None)
            if release:
                let_go(self.link)
        except PortLostError as error:
            return self._gone(str(error))
        limp = not self.link.torque.any()
        return self._outcome(ended, "release" if release else "limp" if limp else "hold", reason)

    def _hold(self) -> PlaybackOutcome:
        """Ctrl-C: hold under watch for a while; a second one lets go."""
        if self.interrupts.terminated:
            return self._leave(PlaybackEnd.INTERRUPTED, "interrupted by SIGTERM, holding")
        before = self.interrupts.count
        self.say(f"holding; Ctrl-C within {self.options.grace:g} s lets go")
        try:
            self._watch(before)
        except PortLostError as error:
            return self._gone(str(error))
        except STOPPING as error:
            return self._leave(PlaybackEnd.FAULT, str(error))
        if self.interrupts.count > before:
            return self._leave(PlaybackEnd.INTERRUPTED, "interrupted twice, released", release=True)
        return self._leave(PlaybackEnd.INTERRUPTED, "interrupted, holding")

    def _watch(self, before: int) -> None:
        """Ticks on the last goal until the grace is over or somebody asks again."""
        assert self.cycle is not None
        goal, due, period = self.cycle.guard.goal.copy(), self._now(), 1 / self._rate
        until = due + self.options.grace
        while due < until and self.interrupts.count == before and not self.interrupts.terminated:
            self._wait(due)
            self.cycle.tick(Step(goal, "hold", goal), period, due)
            self._due = due = due + period
        self.cycle.finish()

    def _gone(self, reason: str) -> PlaybackOutcome:
        watchdog = self.map.watchdog
        after = f"; the servos stop by themselves after {1000 * watchdog:.0f} ms" if watchdog else ""
        after = after or "; the servos have no watchdog and hold their last goals"
        return self._outcome(PlaybackEnd.LOST, "watchdog" if watchdog else "hold", reason + after)

    def _outcome(self, ended: PlaybackEnd, state: str, reason: str) -> PlaybackOutcome:
        if self.cycle is not None:
            self.cycle.account()
        self.record.note(self._now() - self._began, f"{ended.name.lower()}: {reason}; {state}")
        figures = self.record.summary()
        if self.guard is not None:
            limited = zip(self.map.joints, self.guard.limited, strict=True)
            figures["limited"] = {joint: int(n) for joint, n in limited if n}
        return PlaybackOutcome(ended, state, reason, figures, tuple(self.warnings))


def perform(
    servo_map: ServoMap,
    port: str | Path,
    rate: float,
    options: PlaybackOptions,
    record: Record,
    log: str | Path | None,
    say: Callable[[str], None],
    act: Callable[[Performance], PlaybackOutcome],
) -> PlaybackOutcome:
    """Open the bus, act on it at `rate` ticks a second, and write the log of what moved.

    Raises:
        ServoError: as `play`.
    """
    watchdog = servo_map.watchdog
    slow = slow_adapter(port)
    if slow is not None:
        raise ServoError(slow)
    if rate * watchdog < 2 and watchdog:
        raise ServoError(f"{rate:g} ticks a second do not feed a watchdog of {watchdog:g} s; {2 / watchdog:g} do")
    with record.kept(log), Bus(port, servo_map.baud, options.lockstep, servo_map.protocol) as bus:
        return act(Performance(bus, servo_map, rate, options, record, say))


def ticks_to_skip(elapsed: float, period: float) -> int:
    """Return the number of ticks to skip after one that was due `elapsed` ago [s], so that the motion keeps its time.

    After a delay up to `MADE_UP` none is skipped: the late ticks follow at once.
    """
    late = elapsed - period
    return int(late / period) if late > MADE_UP else 0
