"""Receive the newest frame at a port: datagrams, or standard input."""

import os
import select
import socket
import sys
import time
from collections import deque
from typing import NamedTuple, Protocol

from robot_retarget.base.errors import UsageError
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError

# Ports for bytes: datagrams, standard input. Only the system buffers them.

NEWEST = 16_384
"""Bytes of the latest datagrams that are read when more wait [B]: two frames with all bones and a face."""
AT_ONCE = 4096
"""Largest number of datagrams read at once, so that a flood does not delay the robot; 60 bones in a packet each at 60 frames
a second make 3600."""
CHUNK = 65536
"""Bytes of one read; no datagram is longer."""
BUFFER = 1 << 18
"""Size of the system's receive buffer [B]."""


class Packet(NamedTuple):
    """Bytes of one read; no bytes mean that the connection ended."""

    data: bytes
    sender: str
    arrived: float
    """On the monotonic clock [s]."""


class InputPort(Protocol):
    """Receives bytes."""

    ended: bool
    """Whether the port is exhausted."""

    def receive(self, timeout: float) -> list[Packet]:
        """Return the waiting packets; block up to `timeout` [s] for the first."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


class UdpPort:
    """Datagrams; in a flood the latest ones.

    Args:
        host: address to listen at.
        faults: counts refused packets.
        sender: address of the only machine that may send; empty for any.

    Raises:
        UsageError: the port is taken, or may not be used.
    """

    ended = False

    def __init__(self, host: str, port: int, faults: FaultCounter, sender: str = "") -> None:
        self._faults, self._sender = faults, sender
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        self.address: tuple[str, int] = _bound(self._socket, host, port)

    def receive(self, timeout: float) -> list[Packet]:
        if not select.select([self._socket], [], [], max(timeout, 0))[0]:
            return []
        waiting: deque[Packet] = deque()
        size = left_out = 0
        for _ in range(AT_ONCE):
            try:
                data, (host, port) = self._socket.recvfrom(CHUNK)
            except BlockingIOError:
                break
            except OSError:  # a stray ICMP answer
                continue
            if host != (self._sender or host):
                self._faults.note(Fault.OTHER_SENDER, f"{host}:{port}; only {self._sender} may send")
                continue
            if not data:  # an empty packet would mean that a connection ended
                self._faults.note(Fault.MALFORMED, f"an empty datagram of {host}:{port}")
                continue
            waiting.append(Packet(data, f"{host}:{port}", time.monotonic()))
            size += len(data)
            while size - len(waiting[0].data) >= NEWEST:
                size -= len(waiting.popleft().data)
                left_out += 1
        if left_out:
            self._faults.note(Fault.FLOOD, f"{left_out + len(waiting)} at once", left_out)
        return list(waiting)

    def close(self) -> None:
        self._socket.close()


class StdinPort:
    """Standard input until its end."""

    ended = False

    def __init__(self) -> None:
        self._handle = sys.stdin.fileno()

    def receive(self, timeout: float) -> list[Packet]:
        if self.ended or not select.select([self._handle], [], [], max(timeout, 0))[0]:
            return []
        data = os.read(self._handle, CHUNK)
        self.ended = not data
        return [Packet(data, "stdin", time.monotonic())]

    def close(self) -> None:
        """Leave standard input open."""


def _bound(bare: socket.socket, host: str, port: int) -> tuple[str, int]:
    try:
        bare.bind((host, port))
    except (OSError, OverflowError) as error:
        bare.close()
        raise UsageError(f"cannot listen on {host}:{port}: {error}; --port takes another") from error
    return bare.getsockname()[:2]


# Receive the newest frame at a port.

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
