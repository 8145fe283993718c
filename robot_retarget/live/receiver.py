"""Receive the newest frame at a port."""

import time
from typing import Protocol

from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError
from robot_retarget.live.ports import InputPort, Packet

TAKEOVER = 1.0
"""Silence of a sender after which another one may take over [s]."""


class FrameSource(Protocol):
    """Source of frames. Frames that are not fetched in time are dropped, not queued."""

    faults: FaultCounter
    dropped: int
    """Complete frames replaced by newer ones."""

    @property
    def skeleton(self) -> Skeleton | None:
        """Skeleton of the next frames, if known in advance."""
        ...

    @property
    def ended(self) -> bool:
        """Whether the source is exhausted."""
        ...

    def newest(self, timeout: float) -> Frame | None:
        """Return the newest unseen frame; block up to `timeout` [s]."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class Decoder(Protocol):
    """Decodes bytes to frames."""

    skeleton: Skeleton | None

    def feed(self, data: bytes, arrived: float) -> int:
        """Return the number of frames that some bytes complete; count their faults.

        Raises:
            RefusedError: the bytes are not of this protocol.
        """
        ...

    def newest(self) -> Frame:
        """Return the latest complete frame; only this one is converted.

        Raises:
            RefusedError: its values are invalid.
        """
        ...

    def restart(self) -> None:
        """Drop the incomplete frame: another sender takes over."""
        ...


class Receiver:
    """A port with its decoder; follows one sender and refuses others."""

    port: InputPort
    decoder: Decoder
    faults: FaultCounter

    def __init__(self, port: InputPort, decoder: Decoder, faults: FaultCounter) -> None:
        self.port, self.decoder, self.faults = port, decoder, faults
        self.dropped: int = 0
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
