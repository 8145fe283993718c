"""Goals of the servos, tick by tick: stored in the trajectory file, judged by `simulate`, sent by `play`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.actuators.feedback import FIELDS as FEEDBACK_FIELDS
from robot_retarget.actuators.feedback import Feedback, has_all, read_feedback
from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import Field

RATE = 125.0
"""Default rate of goals [1/s]: the cycle of 8 ms of the OP3's own framework."""
TRACKING_RMS = 0.2
"""Largest tracking error (rms) of the worst joint of a motion that passes, simulated or played [rad]: 11°, the error of a
servo with 50 ms lag at 4 rad/s."""
FIELDS = {
    "goals": Field("number", ("N", "n"), required=False),
    "goals_rate": Field("number", required=False),
    "goals_lead_in": Field("number", required=False),
    "goals_lead_out": Field("number", required=False),
    "goals_servos": Field("text", required=False),
}
"""Of the trajectory file."""
KEYS = tuple(FIELDS)
FILE_FIELDS = FIELDS | FEEDBACK_FIELDS
"""Those of goals and of their feedback."""
LARGEST_ANGLE = 100.0
"""An angle of a joint beyond it, sixteen turns, is a mistake [rad]."""
BOUNDS = {"rate": (1.0, 1000.0), "lead_in": (0.0, 60.0), "lead_out": (0.0, 60.0)}
"""Accepted rates [1/s] and settling times [s]; others are mistakes."""


@dataclass(frozen=True, eq=False)
class Goals:
    """Goals at even times: a settling lead-in on the first pose, the motion, a lead-out on the last pose."""

    angles: Floats
    """(N, n) [rad], a column for each of the trajectory's joints; each row is held until the next."""
    rate: float
    """Rows a second [1/s]."""
    lead_in: float = 0.0
    """From the first row to the trajectory's first frame [s]."""
    lead_out: float = 0.0
    """From the trajectory's last frame to the last row [s]."""
    servos: str = ""
    """The servo map they are for (`ServoMap.fingerprint`); empty for the model's own actuators."""
    feedback: Feedback | None = None
    """How an inertial sensor's readings alter them, or None for open-loop playback."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles", frozen(self.angles))
        if self.angles.ndim != 2 or not self.angles.size:
            raise TrajectoryError(f"goals must be (N, n) with at least one row, got {self.angles.shape}")
        require_angles("goals", "row", self.angles)
        for name, (low, high) in BOUNDS.items():
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)
            if not low <= value <= high:
                raise TrajectoryError(f"goals_{name} must be in {low:g} … {high:g}, got {value:g}")
        if self.feedback is not None and self.feedback.reference.shape[0] != len(self.angles):
            raise TrajectoryError(f"feedback_reference has {len(self.feedback.reference)} rows, goals {len(self)}")
        if self.feedback is not None and len(self.feedback.lower) != self.angles.shape[1]:
            raise TrajectoryError(
                f"the feedback is for {len(self.feedback.lower)} joints, goals {self.angles.shape[1]}"
            )

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def times(self) -> Floats:
        """(N,) on the trajectory's clock [s]: negative in the lead-in."""
        return np.arange(len(self)) / self.rate - self.lead_in

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return (len(self) - 1) / self.rate

    def arrays(self) -> dict[str, Any]:
        """The keys of the trajectory file."""
        values = self.angles, self.rate, self.lead_in, self.lead_out, self.servos
        return dict(zip(KEYS, values, strict=True)) | (self.feedback.arrays() if self.feedback else {})


def require_angles(what: str, row: str, angles: Floats, first: int = 0) -> None:
    """Refuse joint angles (N, n) that are not finite, or beyond `LARGEST_ANGLE` [rad].

    Args:
        what: The name of the array, for the message.
        row: The name of one of its rows, for the message.
        first: The column of the array at which the joints begin, for the message.

    Raises:
        TrajectoryError: An angle is a mistake.
    """
    wrong = np.argwhere(~(np.abs(angles) <= LARGEST_ANGLE))
    if not wrong.size:
        return
    k, column = (int(index) for index in wrong[0])
    value = angles[k, column]
    why = f"is {value:g} rad, more than {LARGEST_ANGLE:g}," if np.isfinite(value) else "is not finite"
    raise TrajectoryError(f"{what} {why} at {row} {k}, column {column + first}")


def read_goals(values: Mapping[str, Any]) -> Goals | None:
    """The goals among the keys of a trajectory file, or None.

    Raises:
        TrajectoryError: a key is missing, or the goals are not as they must be.
    """
    if not has_all(values, KEYS):
        return None
    angles, rate, lead_in, lead_out, servos = (values[key] for key in KEYS)
    return Goals(angles, float(rate), float(lead_in), float(lead_out), str(servos), read_feedback(values))
