"""Where bytes come in: datagrams, a connection, standard input. Nothing is kept but what waits in the system's buffers."""

import os
import select
import socket
import sys
import time
from collections import deque
from typing import NamedTuple, Protocol

from robot_retarget.errors import UsageError
from robot_retarget.live.faults import Fault, Faults

NEWEST = 16_384
"""Of the datagrams that wait, the latest are looked at that hold so many bytes: two frames with every bone and a face, in
one datagram or in a hundred."""
AT_ONCE = 4096
"""So many are fetched at once; a flood of more does not keep the robot waiting."""
CHUNK = 65536
"""Bytes read at once; no datagram is longer."""
BUFFER = 1 << 18
"""Bytes that the system keeps of datagrams that were not fetched yet."""


class Packet(NamedTuple):
    """Bytes that came in at once; none of them: the sender is gone."""

    data: bytes
    sender: str
    arrived: float
    """On the monotonic clock [s]."""


class Port(Protocol):
    """A place where bytes come in."""

    ended: bool
    """Nothing will come any more."""

    def receive(self, timeout: float) -> list[Packet]:
        """What has come, waiting for something so long [s]."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


class UdpPort:
    """Datagrams, those that came last if there are many.

    Args:
        host: address to listen at.
        faults: counts what is refused.
        sender: address of the only machine that may send; empty for any.

    Raises:
        UsageError: the port is taken, or may not be used.
    """

    ended = False

    def __init__(self, host: str, port: int, faults: Faults, sender: str = "") -> None:
        self._faults, self._sender = faults, sender
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        self.address = _bound(self._socket, host, port)

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
            except OSError:  # an answer of the system to something that was never sent
                continue
            if host != (self._sender or host):
                self._faults.note(Fault.OTHER_SENDER, f"{host}:{port}; only {self._sender} may send")
                continue
            if not data:  # in a packet, no bytes mean that a connection ended
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


class TcpPort:
    """One connection after the other; who comes while one is open is turned away.

    Args:
        host: address to listen at.
        faults: counts what is refused.
        sender: address of the only machine that may connect; empty for any.

    Raises:
        UsageError: the port is taken, or may not be used.
    """

    ended = False

    def __init__(self, host: str, port: int, faults: Faults, sender: str = "") -> None:
        self._faults, self._sender = faults, sender
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.address = _bound(self._listener, host, port)
        self._listener.listen()
        self._peer: tuple[socket.socket, str] | None = None

    def receive(self, timeout: float) -> list[Packet]:
        sockets = [self._listener, *([self._peer[0]] if self._peer else [])]
        ready = select.select(sockets, [], [], max(timeout, 0))[0]
        if self._listener in ready:
            self._accept()
        if self._peer is None or self._peer[0] not in ready:
            return []
        peer, name = self._peer
        try:
            data = peer.recv(CHUNK)
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return [Packet(data, name, time.monotonic())]

    def _accept(self) -> None:
        peer, (host, port) = self._listener.accept()
        if host != (self._sender or host):
            self._faults.note(Fault.OTHER_SENDER, f"{host}:{port}; only {self._sender} may connect")
            peer.close()
        elif self._peer is None:
            self._peer = peer, f"{host}:{port}"
        else:
            self._faults.note(Fault.OTHER_SENDER, f"{host}:{port} was turned away, {self._peer[1]} is connected")
            peer.close()

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer[0].close()
            self._peer = None

    def close(self) -> None:
        self._hang_up()
        self._listener.close()


class StdinPort:
    """Standard input, to its end."""

    ended = False

    def __init__(self) -> None:
        self._handle = sys.stdin.fileno()

    def receive(self, timeout: float) -> list[Packet]:
        if self.ended or not select.select([self._handle], [], [], max(timeout, 0))[0]:
            return []
        data = os.read(self._handle, CHUNK)
        self.ended = not data
        return [Packet(data, "stdin", time.monotonic())] if data else []

    def close(self) -> None:
        """It is not ours."""


def _bound(bare: socket.socket, host: str, port: int) -> tuple[str, int]:
    try:
        bare.bind((host, port))
    except (OSError, OverflowError) as error:
        bare.close()
        raise UsageError(f"cannot listen on {host}:{port}: {error}; --port takes another") from error
    return bare.getsockname()[:2]
