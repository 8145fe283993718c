"""A sender's time stamps on this computer's clock."""

from robot_retarget.live.faults import Fault, Faults, RefusedError

JUMP = 1.0
"""Stamps that are further from where they were expected are of a clock that was set, or of another sender [s]."""
LEAK = 1e-3
"""By so much a second the offset follows a growing delay: quartz drifts by a tenth of it."""

LEAST = 1e-3
"""Between two frames, where several come at once, or the one before took longer on its way than anything since [s]."""


class SenderClock:
    """t = stamp + offset, with the smallest arrival − stamp of late as offset: what the network adds in jitter is off."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._last = float("-inf")
        self.restart()

    def restart(self) -> None:
        """Forget the offset: another clock follows."""
        self.offset: float | None = None
        """Of this computer's clock from the sender's, with the delay of the quickest frame in it [s]."""
        self._stamp = self._arrived = float("-inf")

    def time(self, stamp: float | None, arrived: float) -> float:
        """When a frame was made; without a stamp, when it arrived.

        Raises:
            RefusedError: its stamp is not after the one before.
        """
        made = arrived if stamp is None else stamp + self._follow(stamp, arrived)
        self._last = max(made, self._last + LEAST)
        return self._last

    def _follow(self, stamp: float, arrived: float) -> float:
        """The offset of now.

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
