"""Dynamixel Protocol 1.0: frames, their checksum, and a parser that resynchronises; the names are those of `protocol`.

Pure functions of bytes; nothing here knows a port. Reference: https://emanual.robotis.com/docs/en/dxl/protocol1/
"""

from collections.abc import Collection, Iterable, Iterator, Sequence

from robot_retarget.servo.protocol import BROADCAST, DynamixelPacket, Error, Instruction, Parser, Question, joined

HEADER = b"\xff\xff"
VERSION = 1
STATUS_SIZE = 6
"""Bytes of a status without data."""
PING_DATA = 0
"""A ping is answered without the model number."""
HARDWARE = 0x25
"""Bits of the error byte that name the state of the servo: input voltage, overheating, overload."""
CODES = {0x02: Error.DATA_RANGE, 0x08: Error.DATA_LIMIT, 0x10: Error.CRC, 0x40: Error.INSTRUCTION}
"""Bits that name a fault of the instruction: beyond the angle limits, out of range, checksum, unknown."""


def frame(identity: int, instruction: int, params: bytes = b"") -> bytes:
    """A frame ready to send."""
    body = bytes((identity, len(params) + 2, instruction)) + params
    return HEADER + body + bytes((~sum(body) & 0xFF,))


def status(identity: int, error: int = 0, data: bytes = b"", hardware: int = 0) -> bytes:
    """A servo's answer."""
    code = next((bit for bit, name in CODES.items() if name == error), 0x08) if error else 0
    return frame(identity, code | hardware & HARDWARE, data)


def verdict(error: int) -> tuple[int, int]:
    """Error code and hardware error bits of a status' error byte."""
    return next((code for bit, code in CODES.items() if error & bit), Error.NONE), error & HARDWARE


def number(value: int) -> bytes:
    """An address or a length in parameters."""
    return bytes((value,))


def read(identity: int, address: int, length: int) -> bytes:
    """Ask one servo for `length` bytes from `address`."""
    return frame(identity, Instruction.READ, bytes((address, length)))


def write(identity: int, address: int, data: bytes) -> bytes:
    """Write to one servo, with an answer."""
    return frame(identity, Instruction.WRITE, bytes((address,)) + data)


def sync_write(address: int, length: int, values: Iterable[tuple[int, bytes]]) -> bytes:
    """Write to several servos at once, without confirmation.

    Raises:
        ValueError: a value has not the announced length.
    """
    return frame(BROADCAST, Instruction.SYNC_WRITE, bytes((address, length)) + joined(values, length))


def questions(address: int, length: int, ids: Sequence[int], chained: Collection[int] = ()) -> list[Question]:
    """Requests for the same bytes of several servos: one bulk read of those that know it, a read of each other one."""
    bulk = [identity for identity in ids if identity in chained]
    bulk = bulk if len(bulk) > 1 else []
    blocks = b"".join(bytes((length, identity, address)) for identity in bulk)
    found = [Question(frame(BROADCAST, Instruction.BULK_READ, b"\0" + blocks), bulk)] if bulk else []
    return found + [Question(read(one, address, length), [one]) for one in ids if one not in bulk]


def answered(frames: bytes) -> bool:
    """Whether the last of some frames requests an answer; only sync writes do not."""
    last = 0
    while len(frames) > last + 4 + frames[last + 3]:
        last += 4 + frames[last + 3]
    return frames[last + 4 : last + 5] != bytes((Instruction.SYNC_WRITE,))


class ChecksumParser(Parser):
    """Frames of Protocol 1 out of a stream of bytes.

    Args:
        strict: as for Protocol 2, which alone has stuffing.
        host: the frames are statuses; a frame that equals one just `sent` is an echo of the adapter and is dropped.
    """

    def __init__(self, strict: bool = False, host: bool = False) -> None:
        super().__init__(strict)
        self._host, self._sent = host, b""

    def clear(self, sent: bytes = b"") -> None:
        """Drop the incomplete frame; remember the frames sent."""
        self._sent = sent
        super().clear()

    def _frames(self) -> Iterator[DynamixelPacket]:
        buffer = self._buffer
        while (place := buffer.find(HEADER)) >= 0:
            del buffer[:place]
            if len(buffer) < STATUS_SIZE:
                return
            end = 4 + buffer[3]
            if buffer[2] == 0xFF or end < STATUS_SIZE:
                del buffer[0]
            elif len(buffer) < end:
                return
            elif ~sum(buffer[2 : end - 1]) & 0xFF != buffer[end - 1]:
                del buffer[0]
            else:
                whole = bytes(buffer[:end])
                del buffer[:end]
                if not self._host:
                    yield DynamixelPacket(whole[2], whole[4], whole[5:-1], end)
                elif whole not in self._sent:
                    yield DynamixelPacket(whole[2], Instruction.STATUS, whole[4:-1], end)
        del buffer[: len(buffer) - buffer.endswith(HEADER[:1])]


parser = ChecksumParser
