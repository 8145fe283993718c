"""Limit goals: joint range, speed, and distance from the present angle."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.map import Limits
from robot_retarget.base.arrays import Floats
from robot_retarget.servo.link import JointScale


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
