"""The newest frame of what comes in at a port."""

import time
from typing import Protocol

from robot_retarget.live.faults import Fault, Faults, RefusedError
from robot_retarget.live.frame import Frame
from robot_retarget.live.ports import Packet, Port
from robot_retarget.motion import Skeleton

TAKEOVER = 1.0
"""Another sender is followed once the one before was silent for so long [s]."""


class Source(Protocol):
    """Where frames come from. Frames that nobody asked for in time are dropped, never queued."""

    faults: Faults
    dropped: int
    """Whole frames that gave way to newer ones."""

    @property
    def skeleton(self) -> Skeleton | None:
        """Of the frames to come, where it is known before."""
        ...

    @property
    def ended(self) -> bool:
        """No frame will come any more."""
        ...

    def newest(self, timeout: float) -> Frame | None:
        """The newest frame that nobody has had yet, waiting for one so long [s]."""
        ...

    def close(self) -> None:
        """Give back what is held."""
        ...


class Decoder(Protocol):
    """What makes frames of bytes."""

    skeleton: Skeleton | None

    def feed(self, data: bytes, arrived: float) -> int:
        """How many whole frames some bytes complete; what is wrong with them is noted.

        Raises:
            RefusedError: nothing of them can be used.
        """
        ...

    def newest(self) -> Frame:
        """The last whole one: frames that gave way to it cost no more than their bytes.

        Raises:
            RefusedError: it is none.
        """
        ...

    def restart(self) -> None:
        """Forget what was begun: another sender follows."""
        ...


class Receiver:
    """A port and what makes frames of its bytes: one sender is followed, others are not mixed in."""

    def __init__(self, port: Port, decoder: Decoder, faults: Faults) -> None:
        self.port, self.decoder, self.faults = port, decoder, faults
        self.dropped = 0
        self._sender, self._heard = "", float("-inf")

    @property
    def skeleton(self) -> Skeleton | None:
        return self.decoder.skeleton

    @property
    def ended(self) -> bool:
        return self.port.ended

    def newest(self, timeout: float) -> Frame | None:
        until = time.monotonic() + timeout
        while True:
            count = self._fed(self.port.receive(until - time.monotonic()))
            self.dropped += max(count - 1, 0)
            if count:
                try:
                    return self.decoder.newest()
                except RefusedError as error:
                    self.faults.refused(error)
            if self.ended or time.monotonic() >= until:
                return None

    def _fed(self, packets: list[Packet]) -> int:
        """Return how many whole frames of the present sender are in the packets."""
        count = 0
        for packet in packets:
            if packet.sender != self._sender:
                if packet.arrived - self._heard < TAKEOVER:
                    self.faults.note(Fault.OTHER_SENDER, f"{packet.sender}; {self._sender} is followed")
                    continue
                self._take_over(packet.sender)
                self.dropped, count = self.dropped + count, 0
            self._heard = packet.arrived if packet.data else float("-inf")
            try:
                count += self.decoder.feed(packet.data, packet.arrived)
            except RefusedError as error:
                self.faults.refused(error)
        return count

    def _take_over(self, sender: str) -> None:
        if self._sender:
            self.faults.note(Fault.RESTARTED, f"{sender} after {self._sender}")
            self.decoder.restart()
        self._sender = sender

    def close(self) -> None:
        self.port.close()
