"""Motion files in a live stream: replayed in real time, and the calibration of a performer."""

import time
from math import floor
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.base.files import replacing
from robot_retarget.base.untrusted.arrays import Field, read_fields
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import FaultCounter, Frame


class Replay:
    """Return the frames of a motion when they are due, starting with the first call; drop overdue ones.

    Raises:
        UsageError: the speed is not positive.
    """

    motion: Motion
    faults: FaultCounter
    dropped: int

    def __init__(self, motion: Motion, faults: FaultCounter, speed: float = 1.0) -> None:
        if not 0 < speed < float("inf"):
            raise UsageError(f"--speed must be positive, got {speed:g}")
        self.motion, self.faults, self.dropped = motion, faults, 0
        self._rate, self._next = motion.fps * speed, 0
        self.began: float | None = None
        """Due time of the first frame [s]."""

    @property
    def skeleton(self) -> Skeleton:
        return self.motion.skeleton

    @property
    def ended(self) -> bool:
        return self._next >= len(self.motion)

    def newest(self, timeout: float) -> Frame | None:
        if self.ended:
            return None
        if self.began is None:
            self.began = time.monotonic()
        ahead = self.began + self._next / self._rate - time.monotonic()
        if ahead > timeout:
            time.sleep(max(timeout, 0.0))
            return None
        time.sleep(max(ahead, 0.0))
        due = min(floor((time.monotonic() - self.began) * self._rate + 1e-6), len(self.motion) - 1)
        t = max(due, self._next)
        self.dropped += t - self._next
        self._next = t + 1
        made, motion = self.began + t / self._rate, self.motion
        turns = None if motion.rotations is None else motion.rotations[t]
        arrived = max(time.monotonic(), made)
        return Frame(motion.skeleton, made, arrived, motion.positions[t], turns, motion.poses_at(t))

    def close(self) -> None:
        """Do nothing: no port is held."""


FARTHEST = 1000.0
"""A joint farther from the origin is a mistake [m]."""
FIELDS = {
    "names": Field("text", ("J",)),
    "parents": Field("integer", ("J",), bounds=(-1, np.inf)),
    "offsets": Field("number", ("J", 3), (-FARTHEST, FARTHEST)),
    "positions": Field("number", ("T", "J", 3), (-FARTHEST, FARTHEST)),
    "fps": Field("number", bounds=(1, 1000)),
    "rotations": Field("number", ("T", "J", 4), (-1.01, 1.01), required=False),
}
"""Of the file."""


def save_calibration(motion: Motion, path: str | Path) -> None:
    """Write a calibration, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    skeleton = motion.skeleton
    arrays: dict[str, Any] = {
        "names": np.array(skeleton.names), "parents": skeleton.parents, "offsets": skeleton.offsets,
        "positions": motion.positions, "fps": np.array(motion.fps),
    }  # fmt: skip
    arrays |= {} if motion.rotations is None else {"rotations": motion.rotations}
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_calibration(path: str | Path) -> Motion:
    """Read a calibration that `save_calibration` wrote.

    Raises:
        MotionError: The file cannot be read, or is not a calibration.
    """
    values = read_fields(path, FIELDS, MotionError)
    if "rotations" in values and not np.allclose(np.linalg.norm(values["rotations"], axis=-1), 1, atol=0.01):
        raise MotionError("rotations must be unit quaternions", path)
    skeleton = Skeleton(tuple(values["names"].tolist()), values["parents"], values["offsets"])
    return Motion(skeleton, values["positions"], values.get("rotations"), float(values["fps"]), str(path))
