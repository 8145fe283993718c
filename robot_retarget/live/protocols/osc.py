"""Open Sound Control packets as messages. A packet that ends too early is refused whole: nothing is made up for what is missing."""

import struct
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from pythonosc.osc_message import OscMessage, ParseError

from robot_retarget.live.faults import Fault, RefusedError

BUNDLE = b"#bundle\0"
HEAD = 16
"""Bytes of a bundle before its first element: its name and a time tag."""
DEEPEST = 4
"""Bundles in bundles."""


class Message(NamedTuple):
    """An address and what is said there."""

    address: str
    values: list[Any]


def messages(packet: bytes, addresses: Collection[bytes]) -> Iterator[Message]:
    """The messages of a packet at some addresses; others are passed over unread.

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
        raise RefusedError(Fault.MALFORMED, f"{len(packet)} bytes that are no OSC")
    at = HEAD
    while at < len(packet):
        size = struct.unpack_from(">i", packet, at)[0] if at + 4 <= len(packet) else -1
        if size <= 0 or at + 4 + size > len(packet):
            raise RefusedError(Fault.MALFORMED, f"an OSC bundle cut off at {len(packet)} bytes")
        yield from _elements(packet[at + 4 : at + 4 + size], deepest - 1)
        at += 4 + size


def _message(element: bytes) -> Message:
    try:
        message = OscMessage(element)
        address, values = message.address, message.params
    except (ParseError, ValueError, IndexError, UnicodeDecodeError) as error:
        raise RefusedError(Fault.MALFORMED, f"an OSC message: {error}") from None
    if len(element) != _length(address, values):
        raise RefusedError(Fault.MALFORMED, f"an OSC message at {address} of {len(element)} bytes")
    return Message(address, values)


def _length(address: str, values: list[Any]) -> int:
    """Bytes of a message whose values are texts and numbers of four bytes: python-osc fills up what is missing."""
    texts = [address, "," + "x" * len(values), *(value for value in values if isinstance(value, str))]
    numbers = sum(not isinstance(value, str) for value in values)
    return sum(len(text.encode()) // 4 * 4 + 4 for text in texts) + 4 * numbers
