"""Frames as lines of JSON.

    {"skeleton": {"names": ["hips", …], "parents": [-1, 0, …], "offsets": [[x, y, z], …]}}
    {"time": 12.345, "positions": [[x, y, z], …], "rotations": [[w, x, y, z], …], "bodies": {"box": [x, y, z, w, x, y, z]}}

Metres, z up, rotations in the world frame. `offsets`, `time`, `rotations` and `bodies` may be left out; a skeleton may come again
at any time, and must where the receiver may have missed it. A datagram holds whole lines.
"""

import json
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
