"""Frames as packed little-endian numbers: a header with the layout, then the numbers.

    "pose"  J (uint16)  width (uint16)  time [s] (float64)  J × width (float32)

Width 3: positions x y z [m], z up. Width 7: and rotations w x y z in the world frame. A file gives the names and parents
of the joints.
"""

import struct

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.faults import Fault, FaultCounter, RefusedError
from robot_retarget.live.frame import Frame
from robot_retarget.live.protocols.clock import SenderClock

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
        if not np.isfinite(stamp):
            raise RefusedError(Fault.NOT_FINITE, "time")
        frame = Frame(self._joints, arrived, arrived, rows[:, :3], rows[:, 3:] if width > 3 else None)
        return frame.at(self.clock.time(stamp, arrived))
