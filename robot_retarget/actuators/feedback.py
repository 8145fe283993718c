"""Balance feedback: an inertial sensor's readings become small additions to goals, the same in simulation and on servos."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY
from robot_retarget.actuators.inertial import Reading, tilt_of
from robot_retarget.base.arrays import Floats, Ints, frozen
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.base.untrusted.arrays import Field

# Complementary filter: the gyroscope turns the vertical, the accelerometer pulls it slowly to where it really is.
#
#     u' = u − (ω × u) dt,        u ← u' + (dt / T) w (a / ‖a‖ − u'),        w = max(0, 1 − |‖a‖ − g| / (g / 2))
#
# A push or a step makes ‖a‖ differ from g and switches the correction off for as long.

TRUST = STANDARD_GRAVITY / 2
"""An acceleration that differs from gravity by this much says nothing about the vertical [m/s²]."""


class Fusion:
    """The vertical in the root body's axes, from reading to reading.

    Args:
        time_constant: of the accelerometer's pull [s].
    """

    def __init__(self, time_constant: float) -> None:
        self._time_constant = time_constant
        self.up: Floats | None = None
        """(3,) the measured vertical; None before the first reading."""

    def step(self, reading: Reading, dt: float) -> Floats:
        """Return roll and pitch (2,) [rad] after a reading, `dt` [s] after the one before."""
        size = float(np.sqrt(reading.accel @ reading.accel))
        felt = reading.accel / size if size > 1e-6 else np.array([0.0, 0.0, 1.0])
        if self.up is None:
            self.up = felt
        wx, wy, wz = reading.gyro
        x, y, z = self.up
        turned = self.up - dt * np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
        trust = max(0.0, 1.0 - abs(size - STANDARD_GRAVITY) / TRUST)
        up = turned + min(1.0, dt / self._time_constant) * trust * (felt - turned)
        self.up = up / np.sqrt(up @ up)
        return tilt_of(self.up)


# The feedback law: the goals of joints oppose the trunk's excess tilt and excess rate over the plan.
#
#     e_θ = θ − θ*,   e_ω = ω − ω*                            roll and pitch of the root body, measured minus planned
#     d   = clip(s (K_ω e_ω + K_θ e_θ), ±bound)               s fades in at the start and out at a sensor fault
#     u   = q* + d                                            d no faster than `speed`, u inside range and top speed
#
# The reference θ*, ω* is that of the reading's row, `lag` rows ago. The gains of a leg are 0 while its foot is planned in the air: there they
# turn the foot, not the trunk, and it lands on an edge.

PREFIX = "feedback_"
"""Prefix of the keys in the trajectory file."""


@dataclass(frozen=True, eq=False)
class Feedback:
    """All parameters of the law; stored with the goals that were judged."""

    rate: Floats
    """(n, 2) added angle of each joint per excess speed in roll and pitch [s]."""
    tilt: Floats
    """(n, 2) added angle per excess tilt."""
    lower: Floats
    upper: Floats
    """(n,) the range of goals [rad]."""
    reference: Floats
    """(N, 4) planned roll, pitch [rad] and their speeds [rad/s], a row for each goal."""
    bound: float
    """[rad]."""
    speed: float
    """Largest rate of the added angle [rad/s]."""
    top_speed: float
    """Largest speed of a goal [rad/s]."""
    lag: int
    """Delay of a reading in rows."""
    fusion: float
    """[s]; see `Fusion`."""
    fade: float
    """[s]."""
    stop: Floats
    """(2,) excess roll and pitch beyond which the robot is falling [rad]."""
    crouch: Floats
    """(n,) the goals in which a falling robot stops [rad]."""
    lean: Floats
    """(n, 2) change of the joints per roll and pitch of the root body over standing feet [-]; zeros without feet."""
    legs: Floats
    """(n, L) 1 for the joints of each leg."""
    air: Floats
    """(N, L) 1 where a foot is planned in the air."""

    def __post_init__(self) -> None:
        for name in SHAPES:
            object.__setattr__(self, name, frozen(getattr(self, name)))
        sizes = {"n": len(self.lower), "N": len(self.reference), "L": self.air.shape[-1]}
        for name, letters in SHAPES.items():
            value, shape = getattr(self, name), tuple(sizes.get(str(size), size) for size in letters)
            if value.shape != shape or not np.isfinite(value).all():
                raise TrajectoryError(f"{PREFIX}{name} must be finite numbers of shape {shape}, got {value.shape}")

    def of(self, order: Ints | list[int]) -> "Feedback":
        """Return the same for other joints, by their indices."""
        names = [name for name, shape in SHAPES.items() if shape[0] == "n"]
        return replace(self, **{name: getattr(self, name)[order] for name in names})

    def arrays(self) -> dict[str, Any]:
        """Return the keys of the trajectory file."""
        return {PREFIX + field.name: getattr(self, field.name) for field in fields(self)}


SHAPES: dict[str, tuple[int | str, ...]] = {
    "rate": ("n", 2), "tilt": ("n", 2), "lower": ("n",), "upper": ("n",), "crouch": ("n",), "lean": ("n", 2),
    "legs": ("n", "L"), "reference": ("N", 4), "air": ("N", "L"), "stop": (2,),
}  # fmt: skip
"""Shapes of the arrays: N goals of n joints, L legs; the fields of a trajectory file share these letters."""
FIELDS = {
    PREFIX + field.name: Field("number", SHAPES.get(field.name, ()), required=False) for field in fields(Feedback)
}
"""Fields of the trajectory file."""
KEYS = tuple(FIELDS)
SWING = ("feedback_legs", "feedback_air")
"""Keys that files of earlier versions do not have: their feedback takes every foot for a standing one."""


def has_all(values: Mapping[str, Any], keys: Sequence[str]) -> bool:
    """Return whether a trajectory file has all of some keys; False if it has none of them.

    Raises:
        TrajectoryError: it has only some.
    """
    there = [key for key in keys if key in values]
    if 0 < len(there) < len(keys):
        raise TrajectoryError(f"it has {there[0]!r} and no {next(key for key in keys if key not in there)!r}")
    return bool(there)


def read_feedback(values: Mapping[str, Any]) -> Feedback | None:
    """Return the feedback among the keys of a trajectory file, or None without any.

    Raises:
        TrajectoryError: a key is missing, or the numbers are invalid.
    """
    swing = has_all(values, SWING)
    if not has_all(values, [key for key in KEYS if key not in SWING]):
        return None
    found = {key.removeprefix(PREFIX): np.asarray(values[key], dtype=float) for key in KEYS if key in values}
    if not swing:
        found |= {"legs": np.zeros((len(found["lower"]), 0)), "air": np.zeros((len(found["reference"]), 0))}
    plain: dict[str, Any] = {name: value if value.ndim else float(value) for name, value in found.items()}
    plain["lag"] = int(plain["lag"])
    return Feedback(**plain)


class Law:
    """The state of one playback.

    Args:
        feedback: gains, bounds and the planned tilt.
        dt: time between two ticks [s].
    """

    def __init__(self, feedback: Feedback, dt: float) -> None:
        self.feedback, self._dt = feedback, dt
        self._fusion = Fusion(feedback.fusion)
        self._share, self._goal, self._row = 0.0, np.zeros(0), 0
        self.added: Floats = np.zeros(len(feedback.lower))
        """(n,) the angle added to the goals [rad]."""
        self.excess: Floats = np.zeros(4)
        """Roll, pitch [rad] and their speeds [rad/s], measured minus planned."""
        self.trusted = True
        """Whether readings may act; after a fault, additions fade out."""
        self.stopped: bool = False
        """Whether the robot leaned beyond the range of the feedback; it then moves to its crouch."""

    def step(self, row: int, plan: Floats, reading: Reading | None) -> Floats:
        """Return the goals (n,) [rad] to send for planned ones; without a finite reading the added angle stays."""
        heard, self._row = reading is not None and reading.finite, row
        if reading is not None and heard:
            self._measure(row, reading)
        if heard or not self.trusted:
            self._add()
        if self.stopped:
            return self._within(self.feedback.crouch, self.feedback.speed)
        return self._within(plan + self.added, self.feedback.top_speed)

    def _measure(self, row: int, reading: Reading) -> None:
        tilt = self._fusion.step(reading, self._dt)
        reference = self.feedback.reference
        planned = reference[min(max(row - self.feedback.lag, 0), len(reference) - 1)]
        self.excess = np.concatenate([tilt, reading.gyro[:2]]) - planned
        self.stopped |= self.trusted and bool((np.abs(self.excess[:2]) > self.feedback.stop).any())

    def _add(self) -> None:
        f, step = self.feedback, self._dt / self.feedback.fade
        self._share = min(1.0, self._share + step) if self.trusted else max(0.0, self._share - step)
        stands = self._share * (1 - f.legs @ f.air[min(self._row, len(f.air) - 1)])
        wanted = stands * np.clip(f.tilt @ self.excess[:2] + f.rate @ self.excess[2:], -f.bound, f.bound)
        reach = f.speed * self._dt
        self.added = self.added + np.clip(wanted - self.added, -reach, reach)

    def _within(self, goal: Floats, speed: float) -> Floats:
        f = self.feedback
        if self._goal.size:
            reach = speed * self._dt
            goal = np.clip(goal, self._goal - reach, self._goal + reach)
        self._goal = np.clip(goal, f.lower, f.upper)
        return self._goal
