"""The last word on every goal: inside the range, not too fast, never far from where the joint is."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from robot_retarget.arrays import Floats, Ints
from robot_retarget.servo.map import TICKS_PER_RADIAN, Limits, ServoMap


class Scale:
    """Ticks and radians of all servos at once, in the order of the map."""

    def __init__(self, servo_map: ServoMap) -> None:
        self.ids = np.array(servo_map.ids, dtype=np.uint8)
        self._zero = np.array([s.zero for s in servo_map.servos], dtype=float)
        self._scale = np.array([s.sign * s.gear * TICKS_PER_RADIAN for s in servo_map.servos])
        ranges = np.array([s.tick_range for s in servo_map.servos])
        self._low, self._high = ranges[:, 0], ranges[:, 1]
        ends = np.array([[s.lower, s.upper] for s in servo_map.servos])
        inside = np.sort(self.radians(ranges.T), axis=0)
        self.lower, self.upper = np.maximum(ends[:, 0], inside[0]), np.minimum(ends[:, 1], inside[1])

    def ticks(self, radians: Floats) -> Ints:
        """The nearest position inside the range."""
        exact = np.rint(self._zero + self._scale * radians)
        return np.minimum(np.maximum(exact, self._low), self._high).astype(np.int64)

    def radians(self, ticks: Ints | Floats) -> Floats:
        return (ticks - self._zero) / self._scale


@dataclass
class Guard:
    """Holds goals to the limits: joint range, speed since the last goal, distance from the present angle."""

    scale: Scale
    limits: Limits
    goal: Floats
    """(n,) the last goal [rad]."""
    held_back: NDArray[np.int64] = field(init=False)
    """(n,) how often the wish of each joint was not granted."""

    def __post_init__(self) -> None:
        self.held_back = np.zeros(len(self.goal), dtype=np.int64)

    def aim(self, wish: Floats, dt: float) -> Floats:
        """What range and speed leave of a wish, before anybody knows where the joints will be.

        A wish that is no number leaves the goal where it is.
        """
        wanted = np.where(np.isfinite(wish), wish, self.goal)
        reach = self.limits.speed * dt
        goal = _between(self.goal - reach, wanted, self.goal + reach)
        return _between(self.scale.lower, goal, self.scale.upper)

    def admit(self, aim: Floats, present: Floats) -> Floats:
        """The goal nearest to an aim that is near enough to the joints; the very same array where all of it is."""
        # A tick of rounding must not carry a goal over the cap.
        cap = self.limits.jump - 1 / TICKS_PER_RADIAN
        if np.abs(aim - present).max() <= cap:
            return aim
        return _between(self.scale.lower, _between(present - cap, aim, present + cap), self.scale.upper)

    def keep(self, goal: Floats, wish: Floats) -> None:
        """Remember a goal that was sent, and whose wish it does not grant."""
        self.held_back += np.abs(goal - wish) > 1e-9
        self.goal = goal


def _between(low: Floats, value: Floats, high: Floats) -> Floats:
    """As `np.clip`, at a third of its time: between two exchanges every microsecond counts."""
    return np.minimum(np.maximum(value, low), high)
