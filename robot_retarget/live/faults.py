"""Faults of a source: counted by kind, and reported at a limited rate."""

import time
from collections import Counter
from collections.abc import Callable
from enum import StrEnum

AGAIN = 2.0
"""Shortest time between two reports of one kind [s]."""


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
