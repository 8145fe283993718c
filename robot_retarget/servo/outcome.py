"""Options, outcome and log of a playback."""

import io
import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from enum import Enum
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.balance_tables import require_bounds, within
from robot_retarget.actuators.goals import TRACKING_RMS
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import OutputError
from robot_retarget.base.files import replacing


class FaultError(Exception):
    """Playback cannot continue; the text gives the reason."""


class HeatError(FaultError):
    """A servo is hot, but it still moves: a short way into a stand is left."""


class PlaybackEnd(Enum):
    """How playing ended; the value is the sentence for it."""

    FINISHED = "played to the end"
    ASTRAY = "played to the end, off the plan"
    INTERRUPTED = "interrupted"
    FAULT = "stopped"
    LOST = "lost the bus"


@dataclass(frozen=True)
class PlaybackOptions:
    """How to play."""

    end_pose: bool = True
    """Go softly to the map's stop pose at the end."""
    release: bool = False
    """Switch torque off after a good end."""
    fast: bool = True
    """Use fast reads where every servo knows them."""
    grace: float = field(default=10.0, metadata=within(0, 3600, "s"))
    """Time after Ctrl-C for which the pose is held and checked; a second Ctrl-C releases [s]."""

    tracking_rms: float = field(default=TRACKING_RMS, metadata=within(0, inf, "rad"))
    """A joint with a larger tracking error (rms) did not follow the plan [rad]."""
    test_lean: bool = True
    """Before a motion with feedback, lean a little and compare the inertial sensor with that."""
    lockstep: bool = False
    """Send each tick as soon as the last is answered, for an emulated bus in lockstep."""

    def __post_init__(self) -> None:
        require_bounds(self)


@dataclass(frozen=True)
class PlaybackOutcome:
    """Outcome of a playback."""

    ended: PlaybackEnd
    state: str
    """`hold`: torque on, goals kept; `release`: torque switched off; `limp`: torque is off, but not by the player;
    `watchdog`: the servos stop by themselves."""
    reason: str
    figures: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """End, reason and state of the servos."""
        how = self.ended.value
        return f"{self.reason if self.reason.startswith(how) else f'{how}: {self.reason}'} ({self.state})"

    def compared(self, tracking_rms: float) -> "PlaybackOutcome":
        """Return the outcome; a motion played to the end with a joint off by more than `tracking_rms` [rad] is astray."""
        off, joint = self.figures.get("worst_joint_rms_rad", 0.0), self.figures.get("worst_joint")
        still = self.figures.get("still_rad") or {}
        if self.ended is PlaybackEnd.FINISHED and still:
            joint, travel = max(still.items(), key=lambda item: item[1])
            reason = f"{joint} stood still while its plan moved by {travel:.2f} rad: jammed, or without power"
            return replace(self, ended=PlaybackEnd.ASTRAY, reason=reason)
        if self.ended is not PlaybackEnd.FINISHED or off <= tracking_rms:
            return self
        reason = f"{joint} was {off:.2f} rad off (rms), more than {tracking_rms:.2g}: jammed, overloaded or too slow"
        return replace(self, ended=PlaybackEnd.ASTRAY, reason=reason)

    @property
    def exit_code(self) -> int:
        return 0 if self.ended is PlaybackEnd.FINISHED else 1


# Jammed joints: they stand still while their plan moves.

STILL = 0.0103
"""A joint that stays within this does not move [rad]: two steps of the encoder of an AX in its data sheet."""
NOTICED = 0.2
"""A joint that stands still while its plan moves by more is jammed; dry friction delays it by less [rad]: twice the 0.09 by which a 2XL430 of 0.252 N m may
lag behind a turn, at the gain of its data sheet. A jam of a joint that moves less in the whole motion is not noticed."""


STOOD = 0.3
"""For at least this long the plan is away [s], as `cycle.STUCK`: after a step of the plan every joint stands still for a moment."""


def standstill(motion: Floats, present: Floats, period: float) -> Floats:
    """Return how far (n,) a plan (N, n) was for `STOOD` from where it was when a joint came to rest [rad].

    Args:
        motion: of the joints [rad].
        present: measured angles of the joints [rad].
        period: between two rows [s].
    """
    found, least = np.zeros(motion.shape[1]), round(STOOD / period)
    for k, (plan, angles) in enumerate(zip(motion.T, present.T, strict=True)):
        start = 0
        while start < len(angles):
            away = np.abs(angles[start:] - angles[start]) > STILL
            end = start + int(away.argmax()) if away.any() else len(angles)
            if end - start > least:
                found[k] = max(found[k], np.sort(np.abs(plan[start:end] - plan[start]))[-1 - least])
            start = end
    return found


# Everything that was sent and heard, tick by tick.

COLUMNS = ("goal", "plan", "motion", "present", "velocity", "current", "age", "error")
PHASES = ("approach", "play", "end", "hold", "lean")


class Journal:
    """The rows of a log in an `.npy` file that is valid after every row, also when the player is killed.

    Args:
        path: the file, which `close` removes.
        most: number of rows, the latest; None for all.
    """

    def __init__(self, path: Path, most: int | None = None) -> None:
        self.path, self._most, self._count = path, most, 0
        self._row: Any = None
        self._header = b""
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}") from error

    def add(self, values: Mapping[str, Any]) -> None:
        """Write a row, then the number of rows; a full disk stops no motion."""
        if not self._header:
            self._row = np.zeros((), dtype=[(name, "<f8", np.shape(value)) for name, value in values.items()])
            stream = io.BytesIO()
            np.lib.format.write_array(stream, np.zeros(0, dtype=self._row.dtype))
            self._header = stream.getvalue()
        for name, value in values.items():
            self._row[name] = value
        place = self._count if self._most is None else self._count % self._most
        self._count += 1
        rows = self._count if self._most is None else min(self._count, self._most)
        before, after = self._header.split(b"(0,)")
        header = (before + b"(%d,)" % rows + after.strip()).ljust(len(self._header) - 1) + b"\n"
        with suppress(OSError):
            os.pwrite(self._file, self._row.tobytes(), len(header) + place * self._row.itemsize)
            os.pwrite(self._file, header, 0)

    def close(self) -> None:
        """Remove the file: the log is saved."""
        os.close(self._file)
        self.path.unlink(missing_ok=True)


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
        self._most = most
        self._journal: Journal | None = None

    @contextmanager
    def kept(self, path: str | Path | None) -> Iterator[None]:
        """Save the log at the end of a block, however it ends; `.part.npy` has its rows meanwhile, and after a kill.

        Raises:
            OutputError: the folder cannot be written.
        """
        if path is None:
            yield
            return
        if Path(path).is_file() or not Path(path).exists():  # a device gets the log alone
            self._journal = Journal(Path(path).with_suffix(".part.npy"), self._most)
        try:
            yield
        finally:
            if len(self) or self.events:
                self.save(path)
            if self._journal is not None:
                self._journal.close()
            self._journal = None

    def __len__(self) -> int:
        return len(self._rows["time"])

    def add(self, **values: Any) -> None:
        """One tick; arrays are copied."""
        for name, rows in self._rows.items():
            value = values[name]
            rows.append(value.copy() if isinstance(value, np.ndarray) else value)
        if self._journal is not None:
            self._journal.add(values)

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
        travel = np.ptp(self.column("motion")[playing], axis=0)
        periods = np.diff(self.column("time")[playing])
        still = np.zeros(len(self.joints))
        if periods.size:
            still = standstill(
                self.column("motion")[playing], self.column("present")[playing], float(np.median(periods))
            )
        return {
            "ticks": len(self),
            "played_ticks": int(playing.sum()),
            "tracking_rms_rad": round(float(np.sqrt((error**2).mean())), 4),
            "worst_joint": self.joints[int(rms.argmax())],
            "worst_joint_rms_rad": round(float(rms.max()), 4),
            "still_rad": {j: round(float(x), 3) for j, x in zip(self.joints, still, strict=True) if x > NOTICED},
            "jams_unnoticed": [joint for joint, moved in zip(self.joints, travel, strict=True) if moved <= NOTICED],
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
