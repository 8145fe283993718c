"""Transfer times of a real wire, servo and USB adapter."""

from dataclasses import dataclass

TURNAROUND = 50e-6
"""From the end of a request, or of another servo's answer, to the start of a servo's answer [s]."""


@dataclass
class WireTiming:
    """The clock of a bus; times in seconds. A baud rate of None makes everything immediate."""

    baud: int | None = None
    usb_latency: float = 0.0
    """Latency of the adapter [s]."""
    free: float = 0.0
    """Time at which the wire is next free [s]."""

    def request(self, now: float, size: int) -> None:
        """Occupy the wire with a request of `size` bytes."""
        if self.baud:
            self.free = max(now, self.free) + size * 10 / self.baud

    def answer(self, now: float, size: int, delay: float) -> float:
        """Return the time at which the host has an answer of `size` bytes, sent after a return delay [s]."""
        if not self.baud:
            return now
        self.free = max(now, self.free) + TURNAROUND + delay + size * 10 / self.baud
        return self.free + self.usb_latency
