"""The loop of a live stream: take the newest frame, solve it, pass its pose on; ease to rest while no frame arrives."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Event
from typing import Any, Protocol

import numpy as np

from robot_retarget.base.errors import MatchError
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import Fault, Frame
from robot_retarget.live.receiver import FrameSource
from robot_retarget.solver.options import RealTime
from robot_retarget.solver.stream import StreamPose as LivePose


class Sink(Protocol):
    """Consumes poses."""

    def show(self, pose: LivePose) -> None:
        """Take a pose without blocking."""
        ...


@dataclass(frozen=True)
class Patience:
    """When a source counts as silent."""

    intervals: float = 2.5
    """Frame intervals without a frame before the robot eases to a stop [-]: a lost frame leaves 2 without one."""
    least: float = 0.03
    most: float = 0.2
    """Bounds of that time [s]: the 2.5 intervals at 83 and at 12.5 frames a second."""
    noted: float = 0.1
    """Shortest pause that is counted and reported [s]: 3 frames at 30 a second."""
    rate: float = RealTime.steps
    """Rate of poses during a silence [1/s]."""


LAST = 36_000
"""Number of latencies kept for the summary: ten minutes at 60 frames a second."""
LATE_FRAME = 0.05
"""Delay above that of the quickest recent frame beyond which a frame counts as late [s]: 3 frames at 60 a second."""


@dataclass
class StreamStats:
    """Figures of a stream."""

    frames: int = 0
    """Solved frames."""
    late: int = 0
    held: int = 0
    """Poses without a frame."""
    seconds: float = 0.0
    """From the first frame on [s]."""
    statuses: dict[str, int] = field(default_factory=dict)
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=LAST))
    """From the arrival of a frame to its pose [s]."""

    def note(self, frame: Frame, pose: LivePose) -> None:
        """Count a solved frame."""
        self.frames += 1
        self.late += frame.arrived - frame.time > LATE_FRAME
        self.latencies.append(time.monotonic() - frame.arrived)
        status = pose.status.name.lower()
        self.statuses[status] = self.statuses.get(status, 0) + 1

    def figures(self, source: FrameSource) -> dict[str, Any]:
        """Return the figures of the summary."""
        p50 = p99 = most = None
        if self.latencies:
            p50, p99, most = (1000 * np.quantile(self.latencies, (0.5, 0.99, 1.0))).round(2).tolist()
        return {
            "frames": self.frames, "dropped": source.dropped, "late": self.late, "held": self.held,
            "seconds": round(self.seconds, 2), "latency_p50_ms": p50, "latency_p99_ms": p99, "latency_max_ms": most,
            "statuses": self.statuses, "faults": dict(source.faults.counts),
        }  # fmt: skip


class Loop:
    """Pass frames of a source through a stream into a sink until the source ends, time is over or `stop` is set."""

    source: FrameSource
    sink: Sink
    stats: StreamStats

    def __init__(
        self,
        source: FrameSource,
        stream_of: Callable[[Skeleton], Any],
        sink: Sink,
        say: Callable[[str], None] = lambda text: None,
        patience: Patience | None = None,
    ) -> None:
        self.source, self.sink, self.stats = source, sink, StreamStats()
        self.stop: Event = Event()
        self.stream: Any = None
        """The stream (`rr.Stream`) of the present performer."""
        self._stream_of, self._say, self._patience = stream_of, say, patience or Patience()
        self._skeleton: Skeleton | None = None
        self._interval = 1 / self._patience.rate
        self.last: Frame | None = None
        """The latest solved frame."""
        self.resting: bool = False
        """Whether the latest pose belongs to no frame."""
        self._silent = False

    def run(self, seconds: float = float("inf")) -> StreamStats:
        """Run for a time after the first frame, and wait no longer than this for it [s]."""
        if self.source.skeleton is not None and self.stream is None:
            self._begin(self.source.skeleton)
        started = time.monotonic()
        began = None if self.last is None else started
        before, spent = self.stats.seconds, 0.0
        while not self.stop.is_set() and not self.source.ended and spent < seconds:
            frame = self.source.newest(self._wait())
            if frame is not None:
                self._answer(frame)
            elif self.last is not None:
                self._rest(self.last)
            now = time.monotonic()
            began = now if began is None and frame is not None else began
            spent = now - (started if began is None else began)
            self.stats.seconds = before + (0.0 if began is None else spent)
        return self.stats

    def _wait(self) -> float:
        """Return the timeout for the next frame [s]."""
        patience = self._patience
        if self.last is None:
            return patience.noted
        quiet = min(max(patience.intervals * self._interval, patience.least), patience.most)
        since = time.monotonic() - self.last.arrived
        return 1 / patience.rate if since >= quiet else quiet - since

    def _answer(self, frame: Frame) -> None:
        stream = self.stream
        if stream is None or frame.skeleton is not self._skeleton:
            stream = self._begin(frame.skeleton)
            frame = self.source.newest(0.0) or frame  # building the stream takes time
        self._gap(frame)
        try:
            pose = stream.push(frame.positions, frame.rotations, time=frame.time, poses=frame.poses)
        except MatchError as error:
            self.source.faults.note(Fault.NO_HUMAN, str(error))
            self._skeleton = None  # calibrate again
            return
        self.sink.show(pose)
        self.stats.note(frame, pose)

    def _begin(self, skeleton: Skeleton) -> Any:
        self._say(f"a performer of {len(skeleton)} joints" + (", another than before" if self._skeleton else ""))
        self._skeleton, self.stream = skeleton, self._stream_of(skeleton)
        return self.stream

    def _gap(self, frame: Frame) -> None:
        """Update the frame interval of the source; report the end of a silence."""
        if self.last is not None:
            gap = frame.arrived - self.last.arrived
            if self._silent:
                self._say(f"frames again after {gap:.2f} s")
            else:
                self._interval += 0.1 * (gap - self._interval)
        self.last, self._silent, self.resting = frame, False, False

    def _rest(self, last: Frame) -> None:
        """Ease to a stop on the clock of the frames."""
        now = time.monotonic()
        if not self._silent and now - last.arrived >= self._patience.noted:
            self._silent = True
            self.source.faults.note(Fault.SILENCE, f"no frame for {now - last.arrived:.1f} s, the robot is held")
        self.resting = True
        if self.stream is not None:
            self.sink.show(self.stream.hold(now - last.arrived + last.time))
            self.stats.held += 1
