"""Frames as lines of JSON, and as packed numbers.

    {"skeleton": {"names": ["hips", …], "parents": [-1, 0, …], "offsets": [[x, y, z], …]}}
    {"time": 12.345, "positions": [[x, y, z], …], "rotations": [[w, x, y, z], …], "bodies": {"box": [x, y, z, w, x, y, z]}}

Metres, z up, rotations in the world frame. `offsets`, `time`, `rotations` and `bodies` may be left out; a skeleton may come again
at any time, and must where the receiver may have missed it. A datagram holds whole lines.
"""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.documents import parse_json
from robot_retarget.human.skeleton import Skeleton, backward
from robot_retarget.live.frame import Fault, FaultCounter, Frame, RefusedError, SenderClock

LONGEST_LINE = 1 << 20
"""Longest line; longer input is dropped [B]."""


def skeleton_line(skeleton: Skeleton) -> bytes:
    """Return the line that defines a skeleton."""
    names, parents, offsets = skeleton.names, skeleton.parents.tolist(), skeleton.offsets.round(5).tolist()
    return _line({"skeleton": {"names": names, "parents": parents, "offsets": offsets}})


def line_of(
    time: float, positions: Floats, rotations: Floats | None = None, poses: Mapping[str, Floats] | None = None
) -> bytes:
    """The line of a frame; positions (J, 3) [m], rotations (J, 4), poses (7,) of bodies by name."""
    frame = {"time": round(time, 6), "positions": np.round(positions, 5).tolist()}
    frame |= {} if rotations is None else {"rotations": np.round(rotations, 6).tolist()}
    return _line(frame | ({"bodies": {name: np.round(p, 6).tolist() for name, p in poses.items()}} if poses else {}))


def _line(message: dict[str, Any]) -> bytes:
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


class LineDecoder:
    """Lines of JSON. `whole`: each packet ends a line, as datagrams do."""

    def __init__(self, faults: FaultCounter, skeleton: Skeleton | None = None, whole: bool = False) -> None:
        self._faults, self._whole = faults, whole
        self.clock: SenderClock = SenderClock(faults)
        self.skeleton = skeleton
        self._tree: dict[str, Any] | None = None
        self._rest = b""
        self._newest: tuple[dict[str, Any], float] = {}, 0.0

    def restart(self) -> None:
        self.clock.restart()
        self._rest = b""

    def feed(self, data: bytes, arrived: float) -> int:
        *lines, rest = (self._rest + data).split(b"\n")
        if self._whole or not data:  # the end of the input ends its last line
            lines, rest = [*lines, rest], b""
        if len(rest) > LONGEST_LINE:
            self._faults.note(Fault.MALFORMED, f"{len(rest)} bytes without the end of a line")
            rest = b""
        self._rest = rest
        count = 0
        for line in filter(bytes.strip, lines):
            try:
                count += self._read(line, arrived)
            except RefusedError as error:
                self._faults.refused(error)
        return count

    def _read(self, line: bytes, arrived: float) -> int:
        """Read a line. Returns 1 for a frame."""
        message = _object(line)
        tree = message.get("skeleton")
        if tree is not None and tree != self._tree:
            self.skeleton, self._tree = _sent_skeleton(tree, message), tree
        if "positions" not in message:
            if tree is None:
                raise RefusedError(Fault.MALFORMED, f"a line without positions: {line[:60].decode(errors='replace')}")
            return 0
        self._newest = message, arrived
        return 1

    def newest(self) -> Frame:
        message, arrived = self._newest
        if self.skeleton is None:
            raise RefusedError(Fault.MALFORMED, "positions before a skeleton")
        stamp = message.get("time")
        if stamp is not None and (isinstance(stamp, bool) or not isinstance(stamp, int | float)):
            raise RefusedError(Fault.MALFORMED, f"time {stamp!r}")
        bodies = message.get("bodies", {})
        if not isinstance(bodies, dict):
            raise RefusedError(Fault.MALFORMED, "bodies is not an object of poses by name")
        frame = Frame(self.skeleton, arrived, arrived, message["positions"], message.get("rotations"), bodies)
        return frame.at(self.clock.time(stamp, arrived))


def _object(line: bytes) -> dict[str, Any]:
    try:
        message = parse_json(line.decode(), "a line", MotionError)
    except (MotionError, UnicodeDecodeError) as error:
        raise RefusedError(Fault.MALFORMED, f"{error}") from None
    if not isinstance(message, dict):
        raise RefusedError(Fault.MALFORMED, f"a line that is not an object: {line[:60].decode(errors='replace')}")
    return message


def _sent_skeleton(tree: Any, message: dict[str, Any]) -> Skeleton:
    """Return the skeleton of a line; missing offsets come from the frame in the same line.

    Raises:
        RefusedError: the skeleton is invalid.
    """
    try:
        names, parents = tree["names"], np.array(tree["parents"], dtype=np.int64)
        if not all(isinstance(name, str) for name in names):
            raise TypeError("names are texts")
        bare = Skeleton(tuple(names), parents, np.zeros((len(names), 3)))
        offsets = (
            tree["offsets"] if "offsets" in tree else offsets_of(bare, message["positions"], message.get("rotations"))
        )
        if not np.isfinite(np.asarray(offsets, dtype=float)).all():
            raise ValueError("its offsets are not finite")
        return Skeleton(bare.names, bare.parents, offsets)
    except (KeyError, TypeError, ValueError, OverflowError, MotionError) as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else str(error)
        raise RefusedError(Fault.MALFORMED, f"a skeleton: {reason}") from None


def offsets_of(skeleton: Skeleton, positions: Floats, rotations: Floats | None) -> Floats:
    """Return the offsets (J, 3) of the joints in their parents' axes [m]; in world axes without rotations."""
    frame = Frame(skeleton, 0.0, 0.0, positions, rotations)
    turns = frame.rotations
    if turns is None:
        turns = np.tile([1.0, 0, 0, 0], (len(skeleton), 1))
    offsets = backward(skeleton.parents, frame.positions[None], turns[None])[0][0]
    return np.where(skeleton.parents[:, None] < 0, 0.0, offsets)


# Frames as packed little-endian numbers: a header with the layout, then the numbers.
#
#     "pose"  J (uint16)  width (uint16)  time [s] (float64)  J × width (float32)
#
# Width 3: positions x y z [m], z up. Width 7: and rotations w x y z in the world frame. A file gives the names and parents
# of the joints.

MAGIC = b"pose"
HEAD = struct.Struct("<4sHHd")
WIDTHS = (3, 7)


def packed(time: float, rows: Floats) -> bytes:
    """Return a frame as bytes; rows (J, 3) of positions [m], or (J, 7) with rotations."""
    return HEAD.pack(MAGIC, *rows.shape, time) + rows.astype("<f4").tobytes()


class FloatDecoder:
    """Packed frames of one skeleton. `whole`: each packet is a frame, as datagrams are."""

    def __init__(self, faults: FaultCounter, skeleton: Skeleton, whole: bool = False) -> None:
        self._faults, self._joints, self._whole = faults, skeleton, whole
        self.skeleton: Skeleton | None = skeleton
        self.clock: SenderClock = SenderClock(faults)
        self._rest = b""
        self._newest = b"", 0.0

    def restart(self) -> None:
        self.clock.restart()
        self._rest = b""

    def feed(self, data: bytes, arrived: float) -> int:
        self._rest += data
        count = 0
        while (size := self._size()) is not None and len(self._rest) >= size:
            self._newest, self._rest = (self._rest[:size], arrived), self._rest[size:]
            count += 1
        if self._whole and self._rest:
            self._faults.note(Fault.MALFORMED, f"a frame cut off at {len(self._rest)} bytes")
            self._rest = b""
        return count

    def _size(self) -> int | None:
        """Return the bytes of the frame that the rest begins with, once known; drop what begins none."""
        while True:
            self._drop_to_magic()
            if len(self._rest) < HEAD.size:
                return None
            _, joints, width, _ = HEAD.unpack_from(self._rest)
            if width in WIDTHS and joints == len(self._joints):
                return HEAD.size + 4 * joints * width
            wrong = f"a frame of {joints} × {width} numbers, the skeleton has {len(self._joints)}"
            self._faults.note(Fault.MALFORMED, wrong)
            self._rest = self._rest[len(MAGIC) :]

    def _drop_to_magic(self) -> None:
        start = self._rest.find(MAGIC)
        strange = len(self._rest) - len(MAGIC) + 1 if start < 0 else start
        if strange > 0:
            self._faults.note(Fault.MALFORMED, f"{strange} bytes that begin no frame")
            self._rest = self._rest[strange:]

    def newest(self) -> Frame:
        data, arrived = self._newest
        _, joints, width, stamp = HEAD.unpack_from(data)
        rows = np.frombuffer(data, "<f4", offset=HEAD.size).reshape(joints, width).astype(float)
        frame = Frame(self._joints, arrived, arrived, rows[:, :3], rows[:, 3:] if width > 3 else None)
        return frame.at(self.clock.time(stamp, arrived))
