"""The exchange of one tick: send goals and a read request, receive readings, check and record them."""

import time
from math import ceil
from typing import Any, NamedTuple

from robot_retarget.base.arrays import Floats
from robot_retarget.servo.guard import Guard
from robot_retarget.servo.judge import Judge
from robot_retarget.servo.link import Link, ServoGoals
from robot_retarget.servo.outcome import PHASES, Record

SPARE = 1.5e-3
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

    link: Link
    guard: Guard
    judge: Judge
    record: Record

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
        if due + period - now > SPARE:
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
