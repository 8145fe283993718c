"""Dynamixel Protocol 2.0: frames, their checksum and stuffing, fast-read blocks, and a parser that resynchronises.

Pure functions of bytes; nothing here knows a port. `protocol1` has the same names for Protocol 1. Reference:
https://emanual.robotis.com/docs/en/dxl/protocol2/
"""

from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from enum import IntEnum
from struct import unpack_from
from typing import NamedTuple

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
LAST_ID = 252
LONGEST_FRAME = 4096
"""A frame that claims more bytes than this after its length field is noise."""

CLEAR_MULTI_TURN = b"\x01\x44\x58\x4c\x22"
VERSION = 2
STATUS_SIZE = 11
"""Bytes of a status without data."""
PING_DATA = 3
"""Bytes of data in the answer to a ping: model number and firmware."""

NO_MORE = HEADER + b"\xfd\x04\x00\x55\x00\x00\x00"
"""Ends the answers to a request on an emulated bus in lockstep, whose time stands still: no servo has the id 253, and no checksum is 0."""


class Instruction(IntEnum):
    """Instruction of a frame; STATUS is an answer."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92


class Error(IntEnum):
    """The low seven bits of a status' error byte."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80
"""The bit of the error byte that says: a hardware error is pending, read register 70."""


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
        table.append(crc)
    return tuple(table)


_CRC = _crc_table()
_CRC_OF_PAIR = array(
    "H", ((_CRC[_CRC[pair >> 8] >> 8 ^ pair & 0xFF] ^ _CRC[pair >> 8] << 8) & 0xFFFF for pair in range(65536))
)
"""Two bytes at a step, in 128 kB that a processor's cache holds: a third of the time for the player's every tick."""


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16/UMTS: polynomial 0x8005, start 0, no reflection. `crc16(b"123456789") == 0xFEE8`."""
    table = _CRC_OF_PAIR
    for pair in unpack_from(f">{len(data) // 2}H", data):
        crc = table[crc ^ pair]
    if len(data) % 2:
        crc = (crc << 8 & 0xFF00) ^ _CRC[crc >> 8 ^ data[-1]]
    return crc


def stuff(data: bytes) -> bytes:
    """Break up every FF FF FD by an FD behind it, so that no header can appear inside a frame."""
    return data.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuff(data: bytes) -> bytes:
    """The inverse of `stuff`."""
    return data.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def word(value: int) -> bytes:
    """Two bytes, low first."""
    return value.to_bytes(2, "little")


class DynamixelPacket(NamedTuple):
    """One frame as it came off the wire, its checksum already found right."""

    id: int
    instruction: int
    params: bytes
    """The parameters, unstuffed; those of a status begin with its error byte."""
    size: int = 0
    """Of the whole frame [B]."""

    @property
    def error(self) -> int:
        """The error byte of a status."""
        return self.params[0] if self.params else 0

    @property
    def data(self) -> bytes:
        """Data of a status after its error byte."""
        return self.params[1:]


def frame(identity: int, instruction: int, params: bytes = b"") -> bytes:
    """A frame ready to send."""
    body = stuff(bytes((instruction,)) + params)
    whole = HEADER + bytes((identity,)) + word(len(body) + 2) + body
    return whole + word(crc16(whole))


def status(identity: int, error: int = 0, data: bytes = b"", hardware: int = 0) -> bytes:
    """A servo's answer; `hardware` are its hardware errors."""
    return frame(identity, Instruction.STATUS, bytes((error | (ALERT if hardware else 0),)) + data)


def verdict(error: int) -> tuple[int, int]:
    """Error code and alert bit of a status' error byte."""
    return error & ~ALERT, error & ALERT


number = word
"""An address or a length in parameters."""


def read(identity: int, address: int, length: int) -> bytes:
    """Ask one servo for `length` bytes from `address`."""
    return frame(identity, Instruction.READ, word(address) + word(length))


def write(identity: int, address: int, data: bytes) -> bytes:
    """Write to one servo, with an answer."""
    return frame(identity, Instruction.WRITE, word(address) + data)


def sync_read(address: int, length: int, ids: Iterable[int], fast: bool = False) -> bytes:
    """Ask several servos for the same bytes: one answer each, or with `fast` one answer of all."""
    kind = Instruction.FAST_SYNC_READ if fast else Instruction.SYNC_READ
    return frame(BROADCAST, kind, word(address) + word(length) + bytes(ids))


def sync_write(address: int, length: int, values: Iterable[tuple[int, bytes]]) -> bytes:
    """Write to several servos at once, without confirmation.

    Raises:
        ValueError: a value has not the announced length.
    """
    return frame(BROADCAST, Instruction.SYNC_WRITE, word(address) + word(length) + joined(values, length))


def joined(values: Iterable[tuple[int, bytes]], length: int) -> bytes:
    """Return ids and data in a row.

    Raises:
        ValueError: as `sync_write`.
    """
    parts = []
    for identity, data in values:
        if len(data) != length:
            raise ValueError(f"servo {identity} gets {len(data)} bytes, {length} announced")
        parts.append(bytes((identity,)) + data)
    return b"".join(parts)


class Question(NamedTuple):
    """A request for the same bytes of some servos, sent when the one before is answered."""

    frame: bytes
    ids: Sequence[int]
    """Who answers, in this order."""
    joint: bool = False
    """The answers are one frame, that of a fast read."""


def questions(address: int, length: int, ids: Sequence[int], chained: Collection[int] = ()) -> list[Question]:
    """Requests for the same bytes of several servos: one sync read, fast if all know it (`chained`)."""
    fast = set(ids) <= set(chained)
    return [Question(sync_read(address, length, ids, fast), ids, fast)]


def fast_status(blocks: Sequence[tuple[int, int, bytes]]) -> bytes:
    """One answer of several servos, blocks of (error, id, data), each with the checksum of all that went before."""
    length = 1 + sum(4 + len(data) for _, _, data in blocks)
    whole = HEADER + bytes((BROADCAST,)) + word(length) + bytes((Instruction.STATUS,))
    for error, identity, data in blocks:
        whole += bytes((error, identity)) + data
        whole += word(crc16(whole))
    return whole


def fast_blocks(raw: bytes, sizes: Sequence[int]) -> Iterator[tuple[int, int, bytes]]:
    """Blocks (error, id, data) of a fast answer that starts at a header, as far as they came whole.

    Args:
        raw: received bytes, complete or truncated.
        sizes: length of each block's data, in the order of the request.
    """
    # The last checksum covers the others: if it is right, they are.
    last = 8 + sum(sizes) + 4 * len(sizes) - 2
    trusted = raw[last : last + 2] == word(crc16(raw[:last]))
    crc, place = 0 if trusted else crc16(raw[:8]), 8
    for size in sizes:
        end = place + 2 + size
        if not trusted:
            crc = crc16(raw[place:end], crc)
            if raw[end : end + 2] != word(crc):
                return
            crc = crc16(raw[end : end + 2], crc)
        yield raw[place], raw[place + 1], raw[place + 2 : end]
        place = end + 2


def answered(frames: bytes) -> bool:
    """Whether the last of some frames requests an answer; only sync writes do not."""
    return not frames or frames[frames.rfind(HEADER) + 7] != Instruction.SYNC_WRITE


class Parser:
    """Frames out of a stream of bytes; noise, broken frames and false headers are passed over.

    Args:
        strict: drop frames whose content holds an unstuffed FF FF FD, as some hosts send them.
        host: as for Protocol 1, whose statuses look like instructions.
    """

    def __init__(self, strict: bool = False, host: bool = False) -> None:
        del host
        self.strict = strict
        self.broken: int = 0
        """Number of frames with a wrong checksum."""
        self._buffer = bytearray()

    @property
    def pending(self) -> bytes:
        """Bytes of an incomplete frame."""
        return bytes(self._buffer)

    def clear(self, sent: bytes = b"") -> None:
        """Drop the incomplete frame; `sent` are the frames that the next ones answer."""
        del sent
        self._buffer.clear()

    def feed(self, data: bytes) -> list[DynamixelPacket]:
        """Take in bytes; the frames they complete."""
        self._buffer += data
        return list(self._frames())

    def give_up(self) -> list[DynamixelPacket]:
        """The rest of the pending frame is not coming: look for frames behind its header."""
        if self._buffer:
            del self._buffer[0]
        return list(self._frames())

    def _frames(self) -> Iterator[DynamixelPacket]:
        buffer = self._buffer
        while self._align() and len(buffer) >= 7:
            end = 7 + (buffer[5] | buffer[6] << 8)
            if not 10 <= end <= LONGEST_FRAME or buffer[4] in (0xFD, 0xFF):
                del buffer[0]
            elif len(buffer) < end:
                return
            elif crc16(memoryview(buffer)[: end - 2].tobytes()) != buffer[end - 2] | buffer[end - 1] << 8:
                self.broken += 1
                del buffer[0]
            else:
                stuffed = bytes(buffer[8 : end - 2])
                found = DynamixelPacket(buffer[4], buffer[7], unstuff(stuffed), end)
                del buffer[:end]
                if not (self.strict and b"\xff\xff\xfd" in stuffed.replace(b"\xff\xff\xfd\xfd", b".")):
                    yield found

    def _align(self) -> bool:
        """Move the next header to the front. Returns False without one."""
        place = self._buffer.find(HEADER)
        if place < 0:
            keep = next((n for n in (3, 2, 1) if self._buffer.endswith(HEADER[:n])), 0)
            del self._buffer[: len(self._buffer) - keep]
            return False
        del self._buffer[:place]
        return True


parser = Parser
