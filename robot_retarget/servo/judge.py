"""Check readings of the servos against the limits of the map during playback."""

import numpy as np

from robot_retarget.actuators.control_tables import XM430_W350
from robot_retarget.actuators.map import Limits
from robot_retarget.base.arrays import Floats
from robot_retarget.servo.check import hardware_errors
from robot_retarget.servo.link import Link
from robot_retarget.servo.outcome import FaultError, HeatError

MISSES = 2
"""Number of ticks without an answer that counts as silence."""
OVERLOADED = 0.5
"""Longest time above the current limit [s]."""
STUCK = 0.3
"""A joint whose goal the step cap limits for this long does not follow [s]."""
ALERTED = 0x80
"""The bit of `Link.error` for a pending hardware error."""


class Judge:
    """Checks the latest readings of a link."""

    link: Link
    limits: Limits

    def __init__(self, link: Link) -> None:
        self.link, self.limits = link, link.map.limits
        self._high_since: float | None = None
        self.heat_known: bool = False
        """Whether heat is no longer a fault, because the player turned into a stand for it."""

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
            self._hardware(k, self.link.bus.value(self.link.ids[k], XM430_W350["hardware_error_status"]))

    def _state(self) -> None:
        if not self.link.torque.all():
            self.link.read_state(range(len(self.link.ids)))
            limp = self._names(~self.link.torque)
            raise FaultError(f"torque is off on {limp}: restarted (power), or switched off by another program")
        failed = np.flatnonzero(self.link.hardware)
        if failed.size:
            self._hardware(int(failed[0]), int(self.link.hardware[failed[0]]))

    def _hardware(self, k: int, bits: int) -> None:
        servo = self.link.map.servos[k]
        raise FaultError(f"{servo.joint} (servo {servo.id}): hardware error: {hardware_errors(bits)}")

    def _stuck(self, capped_for: Floats) -> None:
        stuck = capped_for > STUCK
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
