"""Decode Open Sound Control packets. A truncated packet is refused as a whole."""

import struct
from collections.abc import Collection, Iterator
from itertools import groupby
from typing import Any, NamedTuple

from robot_retarget.live.faults import Fault, RefusedError

BUNDLE = b"#bundle\0"
HEAD = 16
"""Bytes of a bundle before its first element: name and time tag."""
DEEPEST = 4
"""Largest depth of nested bundles."""
NUMBERS = {"f": "f", "i": "i"}
"""Type tags of numbers of four bytes, as the `struct` module has them."""


class Message(NamedTuple):
    """An address and its values."""

    address: str
    values: list[Any]


def messages(packet: bytes, addresses: Collection[bytes]) -> Iterator[Message]:
    """Yield the messages of a packet at some addresses; skip others.

    Raises:
        RefusedError: the packet is not laid out as OSC, or cut off.
    """
    for element in list(_elements(packet, DEEPEST)):
        end = element.find(b"\0")
        if end < 0:
            raise RefusedError(Fault.MALFORMED, "an OSC address without an end")
        if element[:end] in addresses:
            yield _message(element)


def _elements(packet: bytes, deepest: int) -> Iterator[bytes]:
    if packet.startswith(b"/") and len(packet) % 4 == 0:
        yield packet
        return
    if not packet.startswith(BUNDLE) or len(packet) < HEAD or not deepest:
        raise RefusedError(Fault.MALFORMED, f"{len(packet)} bytes that are not OSC")
    at = HEAD
    while at < len(packet):
        size = struct.unpack_from(">i", packet, at)[0] if at + 4 <= len(packet) else -1
        if size <= 0 or at + 4 + size > len(packet):
            raise RefusedError(Fault.MALFORMED, f"an OSC bundle cut off at {len(packet)} bytes")
        yield from _elements(packet[at + 4 : at + 4 + size], deepest - 1)
        at += 4 + size


def _message(element: bytes) -> Message:
    try:
        address, at = _text(element, 0)
        tags, at = _text(element, at)
        values: list[Any] = []
        for tag, run in groupby(tags[1:]):
            taken, at = _values(element, at, tag, len(list(run)))
            values += taken
    except (KeyError, ValueError, struct.error) as error:
        raise RefusedError(Fault.MALFORMED, f"an OSC message: {error}") from None
    if at != len(element) or not tags.startswith(","):
        raise RefusedError(Fault.MALFORMED, f"an OSC message at {address} of {len(element)} bytes")
    return Message(address, values)


def _values(element: bytes, at: int, tag: str, count: int) -> tuple[list[Any], int]:
    """Return values of one type, and where they end; texts, and numbers of four bytes."""
    if tag == "s":
        texts: list[Any] = []
        for _ in range(count):
            text, at = _text(element, at)
            texts.append(text)
        return texts, at
    return list(struct.unpack_from(f">{count}{NUMBERS[tag]}", element, at)), at + 4 * count


def _text(element: bytes, at: int) -> tuple[str, int]:
    """Return a text, and where its padding to four bytes ends."""
    end = element.index(b"\0", at)
    return element[at:end].decode(), at + (end - at) // 4 * 4 + 4
