"""Play a trajectory on servos: check, engage, approach, play, end; stop safely on any fault."""

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.balance_tables import Balance
from robot_retarget.actuators.map import ServoMap
from robot_retarget.errors import ServoError
from robot_retarget.feedback.law import Feedback
from robot_retarget.feedback.lean import LEAN, LeanTest
from robot_retarget.goals import RATE
from robot_retarget.servo.bus import Bus, NoAnswerError, PortLostError, StatusError, slow_adapter
from robot_retarget.servo.check import Condition, ServoFinding, check
from robot_retarget.servo.clock import real_time, wait_until, without_sleep_states
from robot_retarget.servo.cycle import Cycle, Step
from robot_retarget.servo.fall import FallGuard
from robot_retarget.servo.feedback import Balancer, require_sound
from robot_retarget.servo.guard import Guard
from robot_retarget.servo.hold import leave_holding, let_go, take_hold
from robot_retarget.servo.interrupts import Interrupts
from robot_retarget.servo.judge import Judge
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import FaultError, HeatError, PlaybackEnd, PlaybackOptions, PlaybackOutcome
from robot_retarget.servo.plan import ServoPlan, glide
from robot_retarget.servo.playlist import Piece
from robot_retarget.servo.record import Record
from robot_retarget.servo.scale import JointScale
from robot_retarget.servo.sensor import open_sensor
from robot_retarget.servo.ways import Course

STOPPING = (FaultError, NoAnswerError, StatusError)
"""Errors that end a motion with all servos holding."""
MADE_UP = 0.025
"""Ticks up to this late are sent at once, one after the other; later ones are skipped [s]. The motion keeps its mean speed."""


class _InterruptError(Exception):
    """Somebody asked to stop."""


class Player:
    """One performance on an open bus. `play` runs it."""

    link: Link
    guard: Guard | None = None
    cycle: Cycle | None = None

    bus: Bus
    map: ServoMap
    options: PlaybackOptions
    record: Record
    say: Callable[[str], None]

    def __init__(
        self,
        bus: Bus,
        servo_map: ServoMap,
        options: PlaybackOptions,
        record: Record,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.bus, self.map, self.options, self.record, self.say = bus, servo_map, options, record, say
        self.warnings: list[str] = []
        self.interrupts: Interrupts = Interrupts()
        self._began = time.monotonic()
        self._rate = RATE
        self._heeded = 0
        """Interrupts after which a motion went on into a stand."""
        self._heat = ""
        """The heat after which it did."""

    def play(self, pieces: Sequence[Piece]) -> PlaybackOutcome:
        """Check, engage, approach and play each piece, end; when somebody asks to stop, take a way into a stand.

        Raises:
            ServoError: the robot is not fit to be moved; nothing was moved.
        """
        watches = [
            self._fall_guard(piece.plan)
            if piece.plan.feedback is None
            else self._balancer(piece.plan, piece.plan.feedback)
            for piece in pieces
        ]
        outcome = self.perform(pieces[0].plan.rate, lambda cycle: self._perform(cycle, pieces, watches))
        return outcome.compared(self.options.tracking_rms)

    @property
    def stood(self) -> bool:
        """Whether the motion went into a stand before its end."""
        return bool(self._heeded or self._heat)

    def _balancer(self, plan: ServoPlan, feedback: Feedback) -> Balancer:
        """Return the feedback of a plan, its sensor checked."""
        imu = self.map.imu
        if imu is None:
            raise ServoError("the goals were judged with feedback, and the servo map has no [imu]; see --no-feedback")
        sensor = open_sensor(self.bus, imu)
        require_sound(sensor, imu, self.options.lockstep)
        return Balancer(feedback, plan, sensor, imu, self.map.balance or Balance(), self._note_fault)

    def _fall_guard(self, plan: ServoPlan) -> FallGuard | None:
        """Return the watch over a free robot that has an inertial sensor."""
        imu = self.map.imu
        if imu is None or plan.up is None:
            return None
        try:
            sensor = open_sensor(self.bus, imu)
        except ServoError as error:
            self._note_fault(f"{error}: a fall stops nothing")
            return None
        return FallGuard(plan, sensor, imu, self.map.balance or Balance(), self._note_fault)

    def _note_fault(self, text: str) -> None:
        self.warnings.append(text)
        self.record.note(time.monotonic() - self._began, text)
        self.say(text)

    def perform(self, rate: float, act: Callable[[Cycle], str]) -> PlaybackOutcome:
        """Check, engage, act at `rate` ticks a second, and end safely; `act` returns the reason of the end.

        Raises:
            ServoError: the robot is not fit to be moved; nothing was moved.
        """
        conditions = self.examine()
        self._rate = rate
        with self.interrupts.listening(), real_time(), without_sleep_states():
            try:
                self.link = Link(self.bus, self.map, conditions)
                self.link.fast &= self.options.fast
                self.say("taking hold")
                self.cycle = self._engaged()
                reason = act(self.cycle)
                if self._heat:
                    return self._leave(PlaybackEnd.FAULT, f"{self._heat}; standing")
                if self._heeded:
                    return self._leave(PlaybackEnd.INTERRUPTED, "interrupted, standing")
                return self._leave(PlaybackEnd.FINISHED, reason, self.options.release)
            except PortLostError as error:
                return self._gone(str(error))
            except _InterruptError:
                return self._hold()
            except STOPPING as error:
                return self._leave(PlaybackEnd.FAULT, str(error))

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

    def _engaged(self) -> Cycle:
        judge = Judge(self.link)
        self.guard = take_hold(self.link, judge)
        return Cycle(self.link, self.guard, judge, self.record, self._began, self.options.lockstep)

    def _perform(self, cycle: Cycle, pieces: Sequence[Piece], watches: Sequence[FallGuard | None]) -> str:
        watch = None
        for k, (piece, watch) in enumerate(zip(pieces, watches, strict=True)):
            self._begin(cycle, piece, watch, first=not k)
            self.say(f"playing {piece.plan.duration:.1f} s{f' of {piece.name}' if piece.name else ''}")
            self._follow(cycle, piece.plan, "play", watch, piece.ways)
            if watch is not None:
                watch.require_upright()
            if self.stood:
                return PlaybackEnd.INTERRUPTED.value
        self.move_to_stop_pose(cycle, watch)
        if watch is not None:
            watch.require_upright()
        return PlaybackEnd.FINISHED.value

    def _begin(self, cycle: Cycle, piece: Piece, watch: FallGuard | None, first: bool) -> None:
        """Approach the first pose of a piece, and rest there for its pause."""
        plan = piece.plan
        way = glide(cycle.guard.goal, plan.angles[0], plan.rate, self.map.limits)
        self.say(f"approaching the first frame in {way.duration:.1f} s")
        self._follow(cycle, way, "approach", watch)
        if piece.pause:
            rest = np.tile(plan.angles[0], (round(piece.pause * plan.rate) + 1, 1))
            self._follow(cycle, ServoPlan(rest, plan.rate), "hold", watch)
        if watch is not None:
            watch.ready()
        if first and isinstance(watch, Balancer):
            self._lean(cycle, watch.test(plan.angles[0]), watch)

    def _lean(self, cycle: Cycle, test: LeanTest, balancer: Balancer) -> None:
        """Lean right and ahead, and compare the sensor with that.

        Raises:
            FaultError: the sensor measures another lean; the robot holds its first pose.
        """
        if not (self.options.test_lean and test.possible):
            return
        self.say(f"leaning {np.degrees(LEAN):.0f}° right and ahead to test the inertial sensor")
        goals, last = list(test.goals), len(test.goals) - 1

        def step(k: int) -> Step:
            balancer.lean(test, k)
            return Step(goals[k], "lean", goals[min(k + 1, last)])

        self.run_ticks(cycle, step, lambda: last)
        balancer.require_leant(test)

    def move_to_stop_pose(self, cycle: Cycle, watch: FallGuard | None = None) -> None:
        """Move to the map's stop pose, if it has one and the options allow it."""
        if self.options.end_pose and self.map.stop.pose:
            here = zip(self.map.joints, cycle.guard.goal, strict=True)
            pose = np.array([self.map.stop.pose.get(joint, angle) for joint, angle in here])
            self.say("going to the stop pose")
            self._follow(cycle, glide(cycle.guard.goal, pose, self._rate, self.map.limits), "end", watch)

    def _follow(
        self,
        cycle: Cycle,
        plan: ServoPlan,
        phase: str,
        watch: FallGuard | None = None,
        ways: Sequence[ServoPlan] = (),
    ) -> None:
        """Ticks on an even clock until the plan, or a way out of it, is over."""
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
        """Ticks on an even clock until there is no step any more, or the final one is made.

        Those that come too late are left out, but the last two.

        Args:
            cycle: exchanges with the servos.
            step: gives the step of a tick.
            final: gives the last tick.
            stop: called with a tick when somebody asks to stop, or a servo is hot; whether the steps after it lead into a stand.
        """
        period, began = 1 / self._rate, time.monotonic()
        last, k = began, 0
        while k <= final():
            due = began + k * period
            now = due if self.options.lockstep else wait_until(due)
            if now - last > self.map.limits.watchdog > 0:
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
            late = 0.0 if self.options.lockstep else time.monotonic() - due
            left_out = int(min(ticks_to_skip(late, period), max(0, final() - k - 1)))
            self.record.skipped += left_out
            k += 1 + left_out
        cycle.finish()

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
        self.say(f"holding; Ctrl-C within {self.options.grace:g} s lets go")
        before = self.interrupts.count
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
        goal, due, period = self.cycle.guard.goal.copy(), time.monotonic(), 1 / self._rate
        until = due + self.options.grace
        while time.monotonic() < until and self.interrupts.count == before and not self.interrupts.terminated:
            wait_until(due)
            self.cycle.tick(Step(goal, "hold", goal), period, due)
            due += period
        self.cycle.finish()

    def _gone(self, reason: str) -> PlaybackOutcome:
        watchdog = self.map.limits.watchdog
        after = f"; the servos stop by themselves after {1000 * watchdog:.0f} ms" if watchdog else ""
        return self._outcome(PlaybackEnd.LOST, "watchdog", reason + after)

    def _outcome(self, ended: PlaybackEnd, state: str, reason: str) -> PlaybackOutcome:
        if self.cycle is not None:
            self.cycle.account()
        self.record.note(time.monotonic() - self._began, f"{ended.name.lower()}: {reason}; {state}")
        figures = self.record.summary()
        if self.guard is not None:
            limited = zip(self.map.joints, self.guard.limited, strict=True)
            figures["limited"] = {joint: int(n) for joint, n in limited if n}
        return PlaybackOutcome(ended, state, reason, figures, tuple(self.warnings))


def play(
    plan: ServoPlan | Sequence[Piece],
    servo_map: ServoMap,
    port: str | Path,
    options: PlaybackOptions | None = None,
    log: str | Path | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> PlaybackOutcome:
    """Play a plan on the servos of a map, or several in a row.

    Args:
        plan: judged goals (`plan.goal_plan`) or a plain trajectory (`plan.plain_plan`); or pieces of a playback, whose ways
            into a stand are taken on Ctrl-C or the space bar.
        servo_map: the robot's servos.
        port: a serial port, or that of an emulator.
        options: endings.
        log: where `play.npz` goes; written however playing ends, unless it was refused.
        say: receives progress messages.

    Raises:
        ServoError: the port cannot be opened or is too slow, or the robot is not fit to be moved.
    """
    pieces = [Piece(plan)] if isinstance(plan, ServoPlan) else plan
    return perform(
        servo_map,
        port,
        pieces[0].plan.rate,
        options or PlaybackOptions(),
        Record(servo_map.joints),
        log,
        say,
        lambda p: p.play(pieces),
    )


def perform(
    servo_map: ServoMap,
    port: str | Path,
    rate: float,
    options: PlaybackOptions,
    record: Record,
    log: str | Path | None,
    say: Callable[[str], None],
    act: Callable[[Player], PlaybackOutcome],
) -> PlaybackOutcome:
    """Open the bus, let a player act on it at `rate` ticks a second, and write the log of what moved.

    Raises:
        ServoError: as `play`.
    """
    watchdog = servo_map.limits.watchdog
    slow = slow_adapter(port)
    if slow is not None:
        raise ServoError(slow)
    if rate * watchdog < 2 and watchdog:
        raise ServoError(f"{rate:g} ticks a second do not feed a watchdog of {watchdog:g} s; {2 / watchdog:g} do")
    try:
        with Bus(port, servo_map.baud) as bus:
            return act(Player(bus, servo_map, options, record, say))
    finally:
        if log is not None and (len(record) or record.events):
            record.save(log)


def ticks_to_skip(elapsed: float, period: float) -> int:
    """Return the number of ticks to skip after one that began `elapsed` ago [s]: the motion keeps its time.

    None of a short delay: those are made up for.
    """
    late = elapsed - period
    return int(late / period) if late > MADE_UP else 0


def preview(plan: ServoPlan, servo_map: ServoMap, port: str | Path | None = None) -> dict[str, Any]:
    """What playing would ask of the servos; with a port, the robot is examined, too. Nothing moves.

    Raises:
        ServoError: as `play`.
    """
    scale = JointScale(servo_map)
    outside = np.maximum(plan.angles - scale.upper, scale.lower - plan.angles).max(axis=0)
    facts: dict[str, Any] = {
        "duration_s": round(plan.duration, 3),
        "top_speed_rad_s": round(plan.top_speed, 3),
        "speed_limit_rad_s": servo_map.limits.speed,
        "clipped_rad": {j: round(float(x), 4) for j, x in zip(servo_map.joints, outside, strict=True) if x > 5e-5},
    }
    if port is not None:
        with Bus(port, servo_map.baud) as bus:
            player = Player(bus, servo_map, PlaybackOptions(), Record(servo_map.joints))
            here = np.array([condition.angle for condition in player.examine()])
        way = glide(here, plan.angles[0], plan.rate, servo_map.limits)
        facts |= {"approach_s": round(way.duration, 2), "warnings": player.warnings}
    return facts


def _refusal(findings: list[ServoFinding]) -> str:
    listed = "; ".join(map(str, findings[:6]))
    return f"not fit to be moved: {listed}" + (f"; and {len(findings) - 6} more" if len(findings) > 6 else "")
