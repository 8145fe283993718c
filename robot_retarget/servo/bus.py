"""The open bus: dynamixel-sdk's port as the wire, with its faults mended here and nowhere else.

Frames are made and read by `protocol`, which stuffs on sending and loses nothing on receipt, or `protocol1`. The port is opened for
one owner, waits in `select` and not in a loop, measures time on a clock that does not jump, and reports a pulled cable
as one error. Sync reads give what came, servo by servo, with each servo's own error byte.
"""

import contextlib
import errno
import fcntl
import os
import select
import termios
import threading
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self

import serial
from dynamixel_sdk import PortHandler

from robot_retarget.actuators.control_tables import Register
from robot_retarget.base.errors import ServoError
from robot_retarget.servo import protocol, protocol1
from robot_retarget.servo.protocol import (
    BROADCAST,
    HEADER,
    LAST_ID,
    NO_MORE,
    DynamixelPacket,
    Error,
    Instruction,
    Question,
)

PATIENCE = 0.02
"""Timeout of an answer beyond its time on the wire [s]; covers the 16 ms of a USB adapter with default settings."""
TRIES = 4
"""Number of attempts for a request that must not fail: a wire that loses 1 in 100 loses four in a row once in 10⁸."""
DEAD = 30.0
"""An emulator in lockstep that is silent for this long hangs [s]."""
ANSWER_DELAY = 0.6e-3
"""Longest time before a servo answers [s]: 254 units of 2 µs of the register `return_delay_time`, and the turn of the line."""
CHAIN = HEADER + bytes((BROADCAST,))
"""First bytes of an answer to a fast read."""

CODECS: dict[int, Any] = {1: protocol1, 2: protocol}
"""The modules that make and read frames, by protocol."""

WIRE_ERRORS = (OSError, serial.SerialException, termios.error)


class PortLostError(ServoError):
    """The cable was pulled or the adapter is gone."""


class NoAnswerError(ServoError):
    """A servo does not answer, or its answer is garbled."""


class StatusError(ServoError):
    """A servo refused an instruction."""


class Reply(NamedTuple):
    """Answer of one servo."""

    id: int
    error: int
    """The error code, without the alert bit."""
    hardware: int
    """Pending hardware errors: their bits under Protocol 1, the alert bit under Protocol 2; 0 for none."""
    data: bytes


class SerialPort(PortHandler):
    """The SDK's port, opened exclusively and without its long fixed timeout."""

    ser: serial.Serial

    def setupPort(self, cflag_baud: int) -> Literal[True]:
        """Open with an exclusive lock; a second owner is refused."""
        if self.is_open:
            self.closePort()
        self.ser = serial.Serial(self.port_name, self.baudrate, timeout=0, write_timeout=1.0, exclusive=True)
        self.is_open = True
        self.tx_time_per_byte = 1e4 / self.baudrate
        del cflag_baud
        return True


class Bus:
    """Servos on one port; used as a context manager and from one thread.

    Args:
        path: the serial port, or an emulator's.
        baud: one of those the SDK's port knows [1/s].
        lockstep: for an emulator whose time stands still meanwhile, which ends its answers by `NO_MORE`: nothing depends on the clock.
        version: the protocol of the servos, 1 or 2.

    Raises:
        ServoError: the port is not there, is in use, or does not know the baud rate.
    """

    def __init__(self, path: str | Path, baud: int, lockstep: bool = False, version: int = 2) -> None:
        self.path, self.baud, self.lockstep = str(path), baud, lockstep
        self.codec = CODECS[version]
        self._tail, self._over = b"", True
        """In lockstep: bytes that may begin `NO_MORE`, and whether it has come."""
        self._port = SerialPort(self.path)
        self._parser = self.codec.parser(host=True)
        self._owner = threading.get_ident()
        try:
            opened = self._port.setBaudRate(baud)
        except WIRE_ERRORS as error:
            raise ServoError(f"cannot open {path}: {_reason(error)}") from error
        if not opened:
            raise ServoError(f"{path}: no baud rate {baud}")
        self._fd: int = self._port.ser.fileno()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the port; a second call does nothing."""
        if self._port.is_open:
            with contextlib.suppress(*WIRE_ERRORS):
                fcntl.flock(self._fd, fcntl.LOCK_UN)
            with contextlib.suppress(*WIRE_ERRORS):
                self._port.closePort()

    # One servo

    def ping(self, identity: int, tries: int = 1) -> tuple[int, int] | None:
        """Return model number and firmware, or None without an answer."""
        request = self.codec.frame(identity, Instruction.PING)
        for _ in range(tries):
            reply = self._ask(request, identity, self.codec.PING_DATA)
            if reply is not None and not reply.data:  # Protocol 1 has the model in its registers alone
                reply = self._ask(self.codec.read(identity, 0, 3), identity, 3)
            if reply is not None and len(reply.data) == 3:
                return int.from_bytes(reply.data[:2], "little"), reply.data[2]
        return None

    def read(self, identity: int, address: int, length: int, tries: int = TRIES) -> Reply:
        """Bytes of one servo.

        Raises:
            NoAnswerError: no answer, or a garbled one.
            StatusError: the servo refuses.
        """
        request = self.codec.read(identity, address, length)
        return self._insist(request, identity, length, tries, f"read {length} bytes at {address}")

    def try_read(self, request: bytes, identity: int, length: int, patience: float) -> bytes | None:
        """Read bytes of one device once. Returns None if they do not arrive within `patience` [s]."""
        reply = self._ask(request, identity, length, patience)
        return reply.data if reply is not None and not reply.error else None

    def value(self, identity: int, register: Register) -> int:
        """The value of one register."""
        return register.decode(self.read(identity, register.address, register.size).data)

    def write(self, identity: int, register: Register, value: int, tries: int = TRIES) -> Reply:
        """Write one register and wait for the confirmation.

        Raises:
            NoAnswerError: it does not answer.
            StatusError: the register is locked, or the value is beyond a limit of the servo.
            ServoError: the value is not an integer of the register's range; no byte is sent.
        """
        request = self.codec.write(identity, register.address, register.checked(value))
        return self._insist(request, identity, 0, tries, f"write {value} at {register.address}")

    def scan(self, ids: Iterable[int] = range(LAST_ID + 1)) -> Iterator[tuple[int, int, int]]:
        """Yield id, model number and firmware of each servo that answers."""
        for identity in ids:
            found = self.ping(identity)
            if found is not None:
                yield identity, *found

    # All servos

    def read_all(
        self,
        address: int,
        length: int,
        ids: Sequence[int],
        chained: Collection[int] = (),
        patience: float = PATIENCE,
    ) -> dict[int, Reply]:
        """Read the same bytes of many servos. Returns the complete answers by id.

        Args:
            address: of the first byte.
            length: number of bytes.
            ids: of the servos that answer.
            chained: ids that support a fast read, or a bulk read under Protocol 1.
            patience: longest wait beyond the time on the wire, for each request [s].
        """
        found: dict[int, Reply] = {}
        for question in self.codec.questions(address, length, ids, chained):
            self.send(question.frame)
            found |= {reply.id: reply for reply in self.replies(question, length, len(question.frame), patience)}
        return found

    def replies(self, question: Question, length: int, sent: int, patience: float = PATIENCE) -> Iterator[Reply]:
        """Yield the answers to a question that was just sent, the last of `sent` bytes, until they time out."""
        count, each = len(question.ids), self.codec.STATUS_SIZE + length
        size = 8 + count * (4 + length) if question.joint else count * each
        until = self._deadline(sent + size, count, patience)
        if question.joint:
            yield from self._chain(size, length, count, until, patience)
            return
        missing, last = set(question.ids), question.ids[-1]
        # Servos answer in order: after the last one, none is missing.
        while last in missing and (data := self._fetch(until)):
            for frame in self._parser.feed(data):
                if frame.instruction == Instruction.STATUS and frame.id in missing:
                    reply = self._reply(frame)
                    if len(reply.data) == length:
                        missing.remove(frame.id)
                        yield reply
            until = min(until, self._deadline(each * len(missing), len(missing), patience))

    def _chain(self, size: int, length: int, count: int, until: float, patience: float) -> Iterator[Reply]:
        raw = bytearray()
        while len(raw) < size and (data := self._fetch(until)):
            until = min(until, self._deadline(size - len(raw), 0, patience))
            raw += data
            # Bytes of an earlier, late answer may come first.
            start = raw.find(CHAIN)
            if start > 0:
                del raw[:start]
        if raw.startswith(CHAIN):
            for error, identity, data in protocol.fast_blocks(bytes(raw), [length] * count):
                yield Reply(identity, *protocol.verdict(error), data)

    # The wire

    def _insist(self, request: bytes, identity: int, length: int, tries: int, what: str) -> Reply:
        for _ in range(tries):
            reply = self._ask(request, identity, length)
            if reply is not None and reply.error != Error.CRC:
                break
        else:
            raise NoAnswerError(f"servo {identity} does not answer ({what}, {tries} tries)")
        if reply.error:
            name = Error(reply.error).name.lower().replace("_", " ") if reply.error <= 7 else str(reply.error)
            raise StatusError(f"servo {identity}: {what}: {name} error")
        return reply

    def _ask(self, request: bytes, identity: int, length: int, patience: float = PATIENCE) -> Reply | None:
        self.send(request)
        for frame in self._frames(self._deadline(len(request) + self.codec.STATUS_SIZE + length, 1, patience)):
            # Another length is a late answer to another request.
            reply = self._reply(frame)
            if frame.id == identity and (len(reply.data) == length or reply.error):
                return reply
        return None

    def _reply(self, frame: DynamixelPacket) -> Reply:
        code, hardware = self.codec.verdict(frame.error)
        return Reply(frame.id, code, hardware, frame.data)

    def _deadline(self, size: int, servos: int, patience: float) -> float:
        return time.monotonic() + size * 10 / self.baud + servos * ANSWER_DELAY + (DEAD if self.lockstep else patience)

    def _frames(self, until: float) -> Iterator[DynamixelPacket]:
        """Yield status frames until the timeout."""
        while data := self._fetch(until):
            for frame in self._parser.feed(data):
                if frame.instruction == Instruction.STATUS and frame.params:
                    yield frame

    def _fetch(self, until: float) -> bytes:
        """Return received bytes; none after the timeout.

        Raises:
            PortLostError: the port is gone.
        """
        if self.lockstep and self._over:
            return b""
        try:
            ready, _, _ = select.select([self._fd], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                return b""
            data = os.read(self._fd, 4096)
        except (*WIRE_ERRORS, ValueError) as error:
            raise PortLostError(f"{self.path} is gone: {_reason(error)}") from error
        if not data:
            raise PortLostError(f"{self.path} is gone: the other end was closed")
        return self._to_the_end(data, until) if self.lockstep else data

    def _to_the_end(self, data: bytes, until: float) -> bytes:
        """Take `NO_MORE`, whole or in pieces, off received bytes."""
        data = self._tail + data
        self._over = data.endswith(NO_MORE)
        cut = len(NO_MORE) if self._over else next((n for n in range(9, 0, -1) if data.endswith(NO_MORE[:n])), 0)
        keep = len(data) - cut
        self._tail = b"" if self._over else data[keep:]
        return data[:keep] or self._fetch(until)

    def send(self, data: bytes) -> None:
        """Send frames; drop late answers to earlier ones.

        Raises:
            PortLostError: the port is gone.
        """
        if threading.get_ident() != self._owner:
            raise ServoError(f"{self.path} belongs to another thread")
        while self.lockstep and not self._over:
            if not self._fetch(time.monotonic() + DEAD) and not self._over:
                raise PortLostError(f"{self.path} hangs: no emulator in lockstep")
        try:
            termios.tcflush(self._fd, termios.TCIFLUSH)
            self._parser.clear(data)
            sent = os.write(self._fd, data)
            while sent < len(data):
                select.select([], [self._fd], [], 1.0)
                sent += os.write(self._fd, data[sent:])
            self._over, self._tail = not self.codec.answered(data), b""
        except (*WIRE_ERRORS, ValueError) as error:
            raise PortLostError(f"{self.path} is gone: {_reason(error)}") from error


def slow_adapter(path: str | Path) -> str | None:
    """Return a message if a USB adapter delays answers by more than 1 ms, else None."""
    name = Path(os.path.realpath(path)).name
    timer = Path(f"/sys/bus/usb-serial/devices/{name}/latency_timer")
    with contextlib.suppress(OSError, ValueError):
        wait = int(timer.read_text())
        if wait > 1:
            return f"{path}: the adapter waits {wait} ms before it hands on answers; write 1 to {timer}"
    return None


def _reason(error: BaseException) -> str:
    if isinstance(error, BlockingIOError) or "exclusively lock" in str(error):
        return "another program has it"
    if isinstance(error.__context__, termios.error) and error.__context__.args[0] == errno.ENOTTY:
        return "it is not a serial port; give that of the adapter, such as /dev/ttyUSB0, or of `servos emulate`"
    number = error.args[0] if error.args else None
    return os.strerror(number) if isinstance(number, int) else str(error)
