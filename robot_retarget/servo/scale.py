"""Ticks and radians of all servos at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.map import TICKS_PER_RADIAN, ServoMap
from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.servo.outcome import FaultError


class JointScale:
    """Converts between joint angles and servo positions, in the order of the map."""

    low: Floats
    high: Floats
    lower: Any
    upper: Any

    def __init__(self, servo_map: ServoMap) -> None:
        self.joints: tuple[str, ...] = servo_map.joints
        self.ids: NDArray[np.uint8] = np.array(servo_map.ids, dtype=np.uint8)
        self._zero = np.array([s.zero for s in servo_map.servos], dtype=float)
        self._scale = np.array([s.sign * s.gear * TICKS_PER_RADIAN for s in servo_map.servos])
        self.tick: Floats = 1 / np.abs(self._scale)
        """(n,) angle of the joint per tick [rad]."""
        ranges = np.array([s.tick_range for s in servo_map.servos])
        self.low, self.high = ranges[:, 0], ranges[:, 1]
        """(n,) lowest and highest goal [ticks]."""
        self.lower, self.upper = np.array([s.reach for s in servo_map.servos]).T
        """(n,) lowest and highest goal [rad]."""

    def ticks(self, radians: Floats) -> Ints:
        """The nearest positions (n,) inside the range.

        Raises:
            FaultError: an angle is no finite number; says whose.
        """
        finite = np.isfinite(radians)
        if not finite.all():
            k = int(np.argmin(finite))
            raise FaultError(f"the goal of {self.joints[k]} (servo {self.ids[k]}) is {radians[k]}: not sent")
        exact = np.rint(self._zero + self._scale * np.minimum(np.maximum(radians, self.lower), self.upper))
        return np.minimum(np.maximum(exact, self.low), self.high).astype(np.int64)

    def radians(self, ticks: Ints | Floats) -> Floats:
        """The joint angles (n,) at positions of the servos."""
        return (ticks - self._zero) / self._scale
