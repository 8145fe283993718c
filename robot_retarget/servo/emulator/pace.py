"""When bytes are through: the time a real wire, servo and USB adapter would take."""

from dataclasses import dataclass

TURNAROUND = 50e-6
"""From the end of a request, or of another servo's answer, to the start of a servo's answer [s]."""


@dataclass
class Pace:
    """The clock of a bus; times in seconds. A baud rate of None makes everything immediate."""

    baud: int | None = None
    usb_latency: float = 0.0
    """Latency of the adapter [s]."""
    free: float = 0.0
    """When the wire is next free."""

    def request(self, now: float, size: int) -> None:
        """A request of `size` bytes goes onto the wire."""
        if self.baud:
            self.free = max(now, self.free) + size * 10 / self.baud

    def answer(self, now: float, size: int, delay: float) -> float:
        """When an answer of `size` bytes after a return delay has come through to the host."""
        if not self.baud:
            return now
        self.free = max(now, self.free) + TURNAROUND + delay + size * 10 / self.baud
        return self.free + self.usb_latency
