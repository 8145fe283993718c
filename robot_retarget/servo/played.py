"""Read the log of a playback: goals and angles of joints."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.outcome import PHASES


@dataclass(frozen=True, eq=False)
class ServoLog:
    """Goals and angles of joints at even times."""

    joints: tuple[str, ...]
    rate: float
    """Rows a second [1/s]."""
    goals: Floats
    """(N, n) [rad], each held until the next."""
    angles: Floats
    """(N, n) measured [rad], at the times of the goals."""
    voltage: float | None = None
    """Mean of the supply [V]; None takes each servo's nominal one."""

    def __post_init__(self) -> None:
        if self.goals.shape != self.angles.shape or self.goals.shape[1:] != (len(self.joints),):
            raise ServoError(f"{len(self.joints)} joints, goals {self.goals.shape} and angles {self.angles.shape}")
        if len(self.goals) < 2 or not np.isfinite([self.goals, self.angles]).all():
            raise ServoError("a log needs at least two rows, and finite goals and angles")


def read_play_log(path: str | Path) -> ServoLog:
    """Read the played ticks of a `play.npz`.

    Raises:
        ServoError: The file is no log of `play`, or nothing was played.
    """
    try:
        with np.load(path, allow_pickle=False) as log:
            playing = log["phase"] == PHASES.index("play")
            time, goals, angles, voltage = (log[key][playing] for key in ("time", "goal", "present", "voltage"))
            joints = tuple(map(str, log["joint_names"]))
    except (OSError, ValueError, KeyError) as error:
        raise ServoError(f"{path} is no log of `play`: {error}") from error
    if len(time) < 2:
        raise ServoError(f"{path}: nothing was played")
    rate = float(1 / np.median(np.diff(time)))
    return ServoLog(joints, rate, goals, angles, float(voltage.mean()))
