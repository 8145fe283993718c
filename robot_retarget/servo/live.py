"""Follow live poses: approach the first smoothly, rest during a silence, approach again after it.

The player's checks, guard, gate, watchdog, judge and endings apply as for trajectories.
"""

import time
from collections.abc import Callable
from pathlib import Path
from threading import Event, Lock

import numpy as np

from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.map import Limits, ServoMap
from robot_retarget.base.arrays import Floats, minimum_jerk
from robot_retarget.servo.cycle import Cycle, Guard, Step
from robot_retarget.servo.outcome import PlaybackEnd, PlaybackOptions, PlaybackOutcome, Record
from robot_retarget.servo.performance import Performance, perform
from robot_retarget.servo.plan import approach_time

SILENCE = 0.5
"""Silence after which the next target is approached again [s]; the goal rests meanwhile."""
LONGEST_BLEND = 0.1
"""Longest time over which two targets are interpolated [s]: that of the servos' watchdog, 0.1 s."""
LOGGED = 60.0
"""Duration of the log, at the end of the stream [s]: 7,500 ticks at 125 Hz, 12 MB for 20 servos."""


class TargetStream:
    """Targets from another thread, interpolated linearly between the last two.

    After a silence the next target is approached, not interpolated.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._from: Floats | None = None
        self._to = np.zeros(0)
        self._given, self._span = 0.0, LONGEST_BLEND
        self.present: Floats | None = None
        """(n,) of the joints as last read [rad]; None until the servos are engaged."""
        self.over: Event = Event()
        """Set after the last target."""

    def set_target(self, angles: Floats, now: float | None = None) -> None:
        """Set a target (n,) [rad] in the order of the map; one with NaN is ignored."""
        now = time.monotonic() if now is None else now
        target = np.array(angles, dtype=float)
        if not np.isfinite(target).all():
            return
        with self._lock:
            joined = self._from is not None and now - self._given <= SILENCE
            self._from = self._between(now) if joined else target
            self._span = min(max(now - self._given, 1e-3), LONGEST_BLEND)
            self._to, self._given = target, now

    def at(self, now: float) -> Floats | None:
        """Return the target (n,) at a time [s], None before the first."""
        with self._lock:
            return None if self._from is None else self._between(now)

    def age(self, now: float) -> float:
        """Return the time since the last target [s]."""
        return now - self._given

    def _between(self, now: float) -> Floats:
        assert self._from is not None
        share = min((now - self._given) / self._span, 1.0)
        return self._from + share * (self._to - self._from)


class Approach:
    """Approach to a moving target: start + s(u) (target − start), s of minimum jerk."""

    def __init__(self, start: Floats, target: Floats, now: float, limits: Limits) -> None:
        self.start, self.began = start, now
        self.duration: float = approach_time(start, target, limits)

    def at(self, target: Floats, now: float) -> Floats:
        """Return the present goal [rad]."""
        return self.start + minimum_jerk(np.array(min((now - self.began) / self.duration, 1.0))) * (target - self.start)

    def over(self, now: float) -> bool:
        """Return whether the approach is complete."""
        return now - self.began >= self.duration


class TargetFollower:
    """Chooses the target of each tick."""

    def __init__(self, targets: TargetStream, guard: Guard, limits: Limits, say: Callable[[str], None]) -> None:
        self._targets, self._guard, self._limits, self._say = targets, guard, limits, say
        self._approach: Approach | None = None
        self._silent = True
        self._stand: tuple[Approach, Floats] | None = None

    def step(self, now: float) -> Step | None:
        """Return the next step, or None after the last target."""
        if self._stand is not None:
            way, stand = self._stand
            eased_target = way.at(stand, now)
            return None if way.over(now) else Step(eased_target, "end", eased_target)
        if self._targets.over.is_set():
            return None
        target, goal = self._targets.at(now), self._guard.goal
        if target is None or self._targets.age(now) > SILENCE:
            self._silent, self._approach = True, None
            return Step(goal, "hold", goal)
        far = float(np.abs(target - goal).max())
        if self._silent or (self._approach is None and far > self._limits.jump):
            self._begin(goal, target, now, far)
        if self._approach is None:
            return Step(target, "play", target)
        eased_target = self._approach.at(target, now)
        if self._approach.over(now):
            self._approach = None
        return Step(eased_target, "approach", eased_target)

    def leave(self, stand: Floats, now: float) -> bool:
        """Leave the targets for a stand (n,) [rad], as one is approached; return whether this is new."""
        if self._stand is not None:
            return False
        self._stand = Approach(self._guard.goal, stand, now, self._limits), stand
        self._say(f"going into a stand in {self._stand[0].duration:.1f} s; Ctrl-C holds at once")
        return True

    def _begin(self, goal: Floats, target: Floats, now: float, far: float) -> None:
        self._approach, self._silent = Approach(goal, target, now, self._limits), False
        self._say(f"approaching a pose {far:.2f} rad away in {self._approach.duration:.1f} s")


def follow(
    targets: TargetStream,
    servo_map: ServoMap,
    port: str | Path,
    options: PlaybackOptions | None = None,
    rate: float = RATE,
    log: str | Path | None = None,
    say: Callable[[str], None] = lambda text: None,
    clear: Callable[[Floats, Floats], Floats] | None = None,
    stand: Floats | None = None,
) -> PlaybackOutcome:
    """Follow targets on the servos of a map until they end.

    Args:
        targets: set by another thread. Ctrl-C is received if this is called from the main thread.
        servo_map: the robot's servos.
        port: a serial port, or that of an emulator.
        options: endings, as for `play`.
        rate: ticks a second [1/s].
        log: where `play.npz` of the last minute goes; written however it ends.
        say: receives progress messages.
        clear: self-collision guard of the goals (`SelfCollisionGuard.admit`).
        stand: (n,) angles that are approached on Ctrl-C and on the space bar, or when a servo is hot [rad]; None holds.

    Raises:
        ServoError: as `play`.
    """

    def stream_until_end(performance: Performance) -> PlaybackOutcome:
        def tick(cycle: Cycle) -> str:
            cycle.guard.clear = clear
            follower = TargetFollower(targets, cycle.guard, servo_map.limits, say)

            def step(k: int) -> Step | None:
                targets.present = cycle.link.present
                return follower.step(time.monotonic())

            def stop(k: int) -> bool:
                return stand is not None and follower.leave(stand, time.monotonic())

            performance.run_ticks(cycle, step, stop=stop)
            if not performance.stood:
                performance.move_to_stop_pose(cycle)
            return PlaybackEnd.FINISHED.value

        return performance.run(tick)

    record = Record(servo_map.joints, most=round(LOGGED * rate))
    return perform(servo_map, port, rate, options or PlaybackOptions(), record, log, say, stream_until_end)
