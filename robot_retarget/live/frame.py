"""One pose of a performer, checked on arrival; the faults of a source; and a sender's time stamps on this computer's clock."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite

import numpy as np

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.untrusted.arrays import FARTHEST
from robot_retarget.base.untrusted.rotations import LENGTHS
from robot_retarget.human.skeleton import Skeleton

AGAIN = 2.0
"""Shortest time between two reports of one kind [s]: a terminal has at most 30 lines a minute of each."""


class Fault(StrEnum):
    """A kind of fault; the value is its name for users."""

    MALFORMED = "malformed packet"
    NOT_FINITE = "not finite"
    UNKNOWN_BONE = "unknown bone"
    BACKWARDS = "time backwards or repeated"
    CLOCK = "clock of the sender jumped"
    OTHER_SENDER = "packet of another sender"
    RESTARTED = "sender changed or restarted"
    FLOOD = "packet thrown away unread"
    INCOMPLETE = "frame without all its bones"
    NOT_TRACKED = "frame that the performer does not trust"
    NO_HUMAN = "no human recognised"
    SILENCE = "silence"


class RefusedError(Exception):
    """A packet, message or frame is refused."""

    kind: Fault
    detail: str

    def __init__(self, kind: Fault, detail: str = "") -> None:
        super().__init__(f"{kind}: {detail}" if detail else str(kind))
        self.kind, self.detail = kind, detail


class FaultCounter:
    """Count faults by kind; report the first of a kind at once, later ones every two seconds with their number."""

    def __init__(self, say: Callable[[str], None] = lambda text: None) -> None:
        self.counts: Counter[str] = Counter()
        self._say = say
        self._reported: dict[str, tuple[float, int]] = {}

    def note(self, kind: Fault, detail: str = "", count: int = 1) -> None:
        """Count a fault and report it, at most every `AGAIN` seconds."""
        self.counts[str(kind)] += count
        now, total = time.monotonic(), self.counts[str(kind)]
        before, reported = self._reported.get(kind, (-AGAIN, 0))
        if now - before >= AGAIN:
            self._reported[kind] = now, total
            times = f" ({total - reported} times)" if total - reported > 1 else ""
            self._say(f"{kind}{times}" + (f": {detail}" if detail else ""))

    def refused(self, error: RefusedError) -> None:
        """Count a refusal."""
        self.note(error.kind, error.detail)


@dataclass(frozen=True, eq=False)
class Frame:
    """Joint positions and rotations of a skeleton at one time, z up.

    Raises:
        RefusedError: shapes do not fit the skeleton, or a number is not finite or no place or turn.
    """

    skeleton: Skeleton
    time: float
    """On this computer's monotonic clock [s]."""
    arrived: float
    """When the last of it was read, on the same clock [s]."""
    positions: Floats
    """(J, 3) [m]."""
    rotations: Floats | None = None
    """(J, 4) in the world frame, unit w x y z, or None."""
    poses: Mapping[str, Floats] = field(default_factory=dict)
    """(7,) of bodies around by name: x y z [m], quaternion w x y z; the stream checks them."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", self._checked(self.positions, 3))
        if np.abs(self.positions).max() > FARTHEST:
            raise RefusedError(Fault.MALFORMED, f"a joint is more than {FARTHEST:g} m away")
        if self.rotations is None:
            return
        turns = self._checked(self.rotations, 4)
        with np.errstate(over="ignore"):
            lengths = np.sqrt((turns**2).sum(axis=1))
        wrong = ~((lengths > LENGTHS[0]) & (lengths < LENGTHS[1]))
        if wrong.any():
            raise RefusedError(
                Fault.MALFORMED, f"the rotation of {self._named(wrong)} has the length {lengths[wrong][0]:g}"
            )
        object.__setattr__(self, "rotations", frozen(turns / lengths[:, None]))

    def at(self, time: float) -> "Frame":
        """Return the frame at another time [s], without a second check."""
        moved = copy(self)
        object.__setattr__(moved, "time", time)
        return moved

    def _checked(self, values: Floats, width: int) -> Floats:
        try:
            checked = frozen(values)
        except (TypeError, ValueError, OverflowError):
            raise RefusedError(Fault.MALFORMED, "numbers expected") from None
        if checked.shape != (len(self.skeleton), width):
            raise RefusedError(Fault.MALFORMED, f"expected ({len(self.skeleton)}, {width}), got {checked.shape}")
        if not np.isfinite(checked).all():
            raise RefusedError(Fault.NOT_FINITE, self._named(~np.isfinite(checked.sum(axis=1))))
        return checked

    def _named(self, which: np.ndarray) -> str:
        return self.skeleton.names[int(np.argmax(which))]


CLOCK_SET = 1.0
"""A larger step of the offset means that the sender's clock was set [s]."""
LEAK = 1e-3
"""Rate at which the offset follows a growing delay [s/s]: ten times the 1e-4 by which quartz clocks drift."""

LEAST_INTERVAL = 1e-3
"""Shortest time between two frames, for frames that arrive together [s]: no tracker of human motion sends 1000 frames a
second."""


class SenderClock:
    """t = stamp + offset; the offset is the smallest recent arrival − stamp, which removes network jitter."""

    def __init__(self, faults: FaultCounter) -> None:
        self._faults = faults
        self._last = float("-inf")
        self.restart()

    def restart(self) -> None:
        """Drop the offset: the next stamp is of another clock."""
        self.offset: float | None = None
        """This computer's clock minus the sender's, plus the delay of the quickest frame [s]."""
        self._stamp = self._arrived = float("-inf")

    def time(self, stamp: float | None, arrived: float) -> float:
        """Return the time of a frame; without a stamp its arrival.

        Raises:
            RefusedError: its stamp is not after the one before, or not finite.
        """
        if stamp is not None and not isfinite(stamp):
            raise RefusedError(Fault.NOT_FINITE, "time")
        made = arrived if stamp is None else stamp + self._follow(stamp, arrived)
        self._last = max(made, self._last + LEAST_INTERVAL)
        return self._last

    def _follow(self, stamp: float, arrived: float) -> float:
        """Return the updated offset.

        Raises:
            RefusedError: the stamp is not after the one before.
        """
        delay = arrived - stamp
        if self.offset is None:
            self.offset = delay
        elif abs(delay - self.offset) > CLOCK_SET:
            self._faults.note(Fault.CLOCK, f"by {self.offset - delay:.2f} s")
            self.offset = delay
        elif stamp <= self._stamp:
            raise RefusedError(Fault.BACKWARDS, f"by {1000 * (self._stamp - stamp):.1f} ms")
        else:
            self.offset = min(delay, self.offset + LEAK * (arrived - self._arrived))
        self._stamp, self._arrived = stamp, arrived
        return self.offset
