"""Everything that was sent and heard, tick by tick."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import replacing

COLUMNS = ("goal", "plan", "motion", "present", "velocity", "current", "age", "error")
PHASES = ("approach", "play", "end", "hold", "lean")


class Record:
    """A growing log, or one of the latest `most` ticks; saved as `play.npz` even when playing ends badly.

    Arrays: `time` (N,) [s]; `goal` (sent), `plan` (before caps and guards), `motion` (what the
    joints should do), `present` (N, n) [rad]; `velocity` [rad/s]; `current` [A]; `age` (N, n) of
    the readings [s]; `error` (N, n) status byte; `phase` (N,) index into `phases`; `busy` (N,) time on the bus and `late`
    (N,) behind schedule [s]; `voltage` [V] and `temperature` [°C] (N, n), the last known; `events` texts.
    """

    def __init__(self, joints: Sequence[str], most: int | None = None) -> None:
        self.joints: tuple[str, ...] = tuple(joints)
        self.events: list[str] = []
        self.skipped = 0
        """Ticks that gave way to one that took too long."""
        names = "time", "phase", "busy", "late", *COLUMNS, "voltage", "temperature"
        self._rows: dict[str, deque[Any]] = {name: deque(maxlen=most) for name in names}

    def __len__(self) -> int:
        return len(self._rows["time"])

    def add(self, **values: Any) -> None:
        """One tick; arrays are copied."""
        for name, rows in self._rows.items():
            value = values[name]
            rows.append(value.copy() if isinstance(value, np.ndarray) else value)

    def note(self, time: float, text: str) -> None:
        """Something that happened."""
        self.events.append(f"{time:.3f} {text}")

    def column(self, name: str) -> Floats:
        return np.array(self._rows[name])

    def save(self, path: str | Path) -> None:
        """Write the log, whole or not at all."""
        arrays: dict[str, Any] = {name: np.array(rows) for name, rows in self._rows.items()}
        with replacing(path) as scratch, scratch.open("wb") as file:
            np.savez_compressed(
                file, **arrays, joint_names=np.array(self.joints), phases=np.array(PHASES), events=np.array(self.events)
            )

    def summary(self) -> dict[str, Any]:
        """How closely the joints followed the motion, and how even the ticks were."""
        playing = self.column("phase") == PHASES.index("play")
        if not playing.any():
            return {"ticks": len(self), "played_ticks": 0}
        error = (self.column("present") - self.column("motion"))[playing]
        rms = np.sqrt((error**2).mean(axis=0))
        late = self.column("late")[playing]
        periods = np.diff(self.column("time")[playing])
        return {
            "ticks": len(self),
            "played_ticks": int(playing.sum()),
            "tracking_rms_rad": round(float(np.sqrt((error**2).mean())), 4),
            "worst_joint": self.joints[int(rms.argmax())],
            "worst_joint_rms_rad": round(float(rms.max()), 4),
            "largest_current_a": round(float(np.abs(self.column("current")[playing]).max()), 3),
            "hottest_c": float(self.column("temperature")[-1].max()),
            "skipped_ticks": self.skipped,
            "lost_replies": int((self.column("age") > 0).sum()),
            "rate_hz": round(float(1 / periods.mean()), 2) if periods.size else None,
            "jitter_p99_ms": round(1000 * float(np.percentile(np.abs(periods - np.median(periods)), 99)), 3)
            if periods.size
            else None,
            "late_p99_ms": round(1000 * float(np.percentile(late, 99)), 3),
        }
