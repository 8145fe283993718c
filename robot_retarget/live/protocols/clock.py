"""A sender's time stamps on this computer's clock."""

from robot_retarget.live.faults import Fault, FaultCounter, RefusedError

JUMP = 1.0
"""A larger step of the offset means that the sender's clock was set [s]."""
LEAK = 1e-3
"""Rate at which the offset follows a growing delay [s/s]; quartz clocks drift ten times slower."""

LEAST = 1e-3
"""Shortest time between two frames, for frames that arrive together [s]."""


class SenderClock:
    """t = stamp + offset; the offset is the smallest recent arrival − stamp, which removes network jitter."""

    def __init__(self, faults: FaultCounter) -> None:
        self._faults = faults
        self._last = float("-inf")
        self.restart()

    def restart(self) -> None:
        """Drop the offset: the next stamp is of another clock."""
        self.offset: float | None = None
        """This computer's clock minus the sender's, plus the delay of the quickest frame [s]."""
        self._stamp = self._arrived = float("-inf")

    def time(self, stamp: float | None, arrived: float) -> float:
        """Return the time of a frame; without a stamp its arrival.

        Raises:
            RefusedError: its stamp is not after the one before.
        """
        made = arrived if stamp is None else stamp + self._follow(stamp, arrived)
        self._last = max(made, self._last + LEAST)
        return self._last

    def _follow(self, stamp: float, arrived: float) -> float:
        """Return the updated offset.

        Raises:
            RefusedError: the stamp is not after the one before.
        """
        delay = arrived - stamp
        if self.offset is None:
            self.offset = delay
        elif abs(delay - self.offset) > JUMP:
            self._faults.note(Fault.CLOCK, f"by {self.offset - delay:.2f} s")
            self.offset = delay
        elif stamp <= self._stamp:
            raise RefusedError(Fault.BACKWARDS, f"by {1000 * (self._stamp - stamp):.1f} ms")
        else:
            self.offset = min(delay, self.offset + LEAK * (arrived - self._arrived))
        self._stamp, self._arrived = stamp, arrived
        return self.offset
