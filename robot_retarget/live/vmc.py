"""VMC, the protocol of VRM performers: bones in their parents as OSC over UDP, in one packet a frame or in many.

The protocol does not mark where a frame ends. A frame is complete once it has every bone of the frames before. It ends early
where a bone comes twice, or where the bone comes before which the network pauses longest: frames begin with that one.
Packets of one frame may thus be far apart. Sources: protocol.vmc.info, "Marionette" receiving.

OSC is decoded here and not by python-osc 1.10, which decodes every message, 2.4 times as long for a frame with a face, accepts packets
that were cut off, and recurses without a limit.
"""

import struct
from collections.abc import Collection, Iterator
from itertools import groupby
from math import hypot, isfinite
from typing import Any, NamedTuple

import numpy as np

from robot_retarget.human.skeleton import Place, Skeleton, Turn, forward_once
from robot_retarget.live.bones import BONES, OPTIONAL, PASSED_OVER, carriers, mean_offsets, place_of, turn_of
from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError, SenderClock

BUNDLE = b"#bundle\0"
BUNDLE_HEAD = 16
"""Bytes of a bundle before its first element: name and time tag."""
DEEPEST = 4
"""Largest depth of nested bundles; deeper ones are refused."""
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
    if not packet.startswith(BUNDLE) or len(packet) < BUNDLE_HEAD or not deepest:
        raise RefusedError(Fault.MALFORMED, f"{len(packet)} bytes that are not OSC")
    at = BUNDLE_HEAD
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


VMC_PORT = 39539
"""Default UDP port of performers, of the protocol."""
ROOT, BONE, OK, TIME = "/VMC/Ext/Root/Pos", "/VMC/Ext/Bone/Pos", "/VMC/Ext/OK", "/VMC/Ext/T"
ADDRESSES = {address.encode() for address in (ROOT, BONE, OK, TIME)}
PAUSE = 0.004
"""A first bone that comes sooner after the packet before was overtaken on the network and begins no frame [s]: a
quarter of the 16.7 ms of a frame at 60 a second."""
LEARNING = 0.1
"""Weight of a new pause in the mean pause before a bone, which remembers about 10."""
LONGEST_BONE = 2.0
"""A longer bone is a mistake [m]."""
NO_BONE = 1e-3
"""A shorter bone, other than the hips, has no length sent [m]."""
TRACKING = 3
"""Index of the tracking flag in the values of `OK`, since version 2.7."""


Local = tuple[Place, Turn]
"""A place [m] and a turn w x y z."""
STANDING: Local = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
"""Place and turn of a device that stands at the origin, of the protocol."""


class _Whole(NamedTuple):
    """A complete frame as received."""

    bones: dict[str, Local]
    root: Local
    stamp: float | None
    arrived: float
    tracked: bool


class VmcDecoder:
    """Decode frames of the bones that define a pose. The first complete frame gives the skeleton.

    Missing lengths are those of the mean body.
    """

    def __init__(self, faults: FaultCounter) -> None:
        self._faults = faults
        self.clock: SenderClock = SenderClock(faults)
        self.skeleton: Skeleton | None = None
        self._newest: _Whole | None = None
        self.restart()

    def restart(self) -> None:
        self.clock.restart()
        self._local: dict[str, Local] = {}
        self._root = STANDING
        self._stamp: float | None = None
        self._tracked = True
        self._there: dict[str, None] = {}
        """Keys of the frame in progress, in order of arrival."""
        self._pauses: dict[str, float] = {}
        """Mean pause before the packets that begin with each key [s]."""
        self._pause = float("inf")
        """Before the packet, until its first key is read; then 0 [s]."""
        self._expected: set[str] = set()
        self._before: set[str] = set()
        self._arrived = float("-inf")

    def feed(self, data: bytes, arrived: float) -> int:
        self._pause, self._arrived = arrived - self._arrived, arrived
        count = 0
        for message in messages(data, ADDRESSES):
            try:
                count += self._after(message)
            except RefusedError as error:
                self._faults.refused(error)
        return count

    def _after(self, message: Message) -> int:
        """Process a message. Returns 1 if it completes a frame."""
        address, values = message
        if address == OK:
            self._tracked = bool(values[TRACKING]) if len(values) > TRACKING else self._tracked
            return 0
        key, taken = self._read(address, values)
        if not key:
            return 0
        count = self._ended(early=True) if self._begins(key) and self._there else 0
        if address == TIME:
            self._stamp = taken
        elif address == ROOT:
            self._root = taken
        else:
            self._local[key] = taken
        self._there[key] = None
        return self._ended(early=False) if self._expected and self._expected <= self._there.keys() else count

    def _begins(self, key: str) -> bool:
        """Whether a key begins a frame; learns the pauses before packets."""
        pause, self._pause = self._pause, 0.0
        if 0 < pause < float("inf"):
            mean = self._pauses.get(key, pause)
            self._pauses[key] = mean + LEARNING * (pause - mean)
        first = bool(self._expected) and pause >= PAUSE and key == self._first
        return first or key in self._there

    @property
    def _first(self) -> str:
        return max(self._pauses, key=self._pauses.__getitem__, default="")

    def _read(self, address: str, values: list[Any]) -> tuple[str, Any]:
        """Return the key of a message and its value in our axes; an empty key for ignored bones.

        Raises:
            RefusedError: it violates the protocol.
        """
        if address == TIME:
            return TIME, _numbers(values[:1], 1, address)[0]
        name = values[0] if values and isinstance(values[0], str) else ""
        if not name:
            raise RefusedError(Fault.MALFORMED, f"{address} without a name")
        name = name[0].upper() + name[1:]  # VRM 1.0 writes leftHand
        if address == BONE and name not in BONES:
            if name not in PASSED_OVER:
                raise RefusedError(Fault.UNKNOWN_BONE, name[:40])
            return "", None
        numbers = _numbers(values[1:8], 7, name)
        place, turn = numbers[:3], numbers[3:]
        norm = hypot(*turn)
        if norm < 1e-6:
            raise RefusedError(Fault.MALFORMED, f"the rotation of {name} is zero")
        if address == BONE and name != "Hips" and hypot(*place) > LONGEST_BONE:
            raise RefusedError(Fault.MALFORMED, f"{name} is {hypot(*place):.3g} m long")
        return name if address == BONE else ROOT, (place_of(place), turn_of([x / norm for x in turn]))

    def _ended(self, early: bool) -> int:
        """Store the frame in progress as the newest. Returns 1 if it is one."""
        order, self._there = list(self._there), {}
        there = set(order)
        if there.isdisjoint(BONES):
            return 0
        if not self._expected:
            self._expected = there
            return self._join(order)
        self._expected = there if there == self._before else self._expected | there
        self._before = there
        if early and not self._expected <= there:
            self._faults.note(Fault.INCOMPLETE, f"without {', '.join(sorted(self._expected - there)[:4])}")
        stamp = self._stamp if TIME in there else None
        self._newest = _Whole(dict(self._local), self._root, stamp, self._arrived, self._tracked)
        return 1

    def _join(self, order: list[str]) -> int:
        """Keep the keys of the present frame if reception began in the middle of the one before."""
        begun = order.index(self._first) if self._first in order else 0
        self._there = dict.fromkeys(order[begun:]) if begun else {}
        return 0

    def newest(self) -> Frame:
        whole = self._newest
        assert whole is not None
        if not whole.tracked:
            raise RefusedError(Fault.NOT_TRACKED)
        self.skeleton = self.skeleton or _skeleton(whole.bones)
        local = [whole.bones.get(name, STANDING) for name in self.skeleton.names]
        rest = map(tuple, self.skeleton.offsets.tolist())
        places = [at if hypot(*at) >= NO_BONE else offset for (at, _), offset in zip(local, rest, strict=True)]
        parents = [-1, *(self.skeleton.parents + 1).tolist()]
        positions, rotations = forward_once(parents, [whole.root[0], *places], [whole.root[1], *(q for _, q in local)])
        rows = np.array(positions[1:]), np.array(rotations[1:])
        frame = Frame(self.skeleton, whole.arrived, whole.arrived, *rows)
        return frame.at(self.clock.time(whole.stamp, whole.arrived))


def _skeleton(bones: dict[str, Local]) -> Skeleton:
    """Return the skeleton of the received bones.

    Raises:
        RefusedError: a bone that every VRM has is missing.
    """
    lacking = [bone for bone in BONES if bone not in bones and bone not in OPTIONAL]
    if lacking:
        raise RefusedError(Fault.INCOMPLETE, f"no body without {', '.join(lacking[:4])}")
    above, mean = carriers(bones), mean_offsets(bones)
    names = tuple(above)
    parents = np.array([names.index(above[name]) if above[name] else -1 for name in names])
    sent = {name: bones[name][0] for name in names}
    offsets = [sent[name] if hypot(*sent[name]) >= NO_BONE else mean[name] for name in names]
    return Skeleton(names, parents, np.array(offsets))


def _numbers(values: list[Any], count: int, what: str) -> list[float]:
    """Return `count` finite numbers.

    Raises:
        RefusedError: fewer, or others.
    """
    if len(values) < count or not all(isinstance(value, int | float) for value in values):
        raise RefusedError(Fault.MALFORMED, f"{what}: {count} numbers expected")
    if not all(isfinite(value) for value in values):
        raise RefusedError(Fault.NOT_FINITE, what)
    return [float(value) for value in values]
