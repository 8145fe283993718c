"""The last look at goals before the wire, whoever made them: this is the only place that lets one through."""

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.map import TICKS_PER_RADIAN, ServoMap
from robot_retarget.base.arrays import Ints
from robot_retarget.servo.outcome import FaultError
from robot_retarget.servo.scale import JointScale


class Gate:
    """Lets through whole ticks inside their servos' ranges that are no further from the shafts than the step cap."""

    def __init__(self, servo_map: ServoMap, scale: JointScale) -> None:
        self._map, self._scale = servo_map, scale
        gears = np.array([servo.gear for servo in servo_map.servos])
        self._cap = np.floor(servo_map.limits.jump * gears * TICKS_PER_RADIAN)

    def allowed(self, ticks: Ints, present: Ints) -> NDArray[np.bool_]:
        """(n,) which of the goals [ticks] may go to servos whose shafts are at `present` [ticks]; no number may not."""
        whole = np.equal(ticks, np.rint(ticks))
        inside = (self._scale.low <= ticks) & (ticks <= self._scale.high)
        return whole & inside & (np.abs(np.subtract(ticks, present, dtype=float)) <= self._cap)

    def require(self, ticks: Ints, present: Ints) -> None:
        """Check that all goals may go out.

        Raises:
            FaultError: one may not; says whose.
        """
        allowed = self.allowed(ticks, present)
        if not allowed.all():
            k = int(np.argmin(allowed))
            servo, cap = self._map.servos[k], self._map.limits.jump
            low, high = servo.tick_range
            where = f"goal {ticks[k]}, shaft at {present[k]} ticks"
            what = f"no whole tick of {low}…{high} within {cap:g} rad of its shaft ({where})"
            raise FaultError(f"{servo.joint} (servo {servo.id}) was to be sent {what}: not sent")
