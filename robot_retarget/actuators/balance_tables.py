"""The tables `[imu]` and `[balance]` of a servo map: the inertial sensor, and the gains from its readings to goals."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError

# Numbers that are checked where they come in: each field of a dataclass states the range outside which it is a mistake.


class MapError(ServoError):
    """A value of a servo map that cannot be; `key` is its place in the file, from the top."""

    def __init__(self, message: str, *key: str) -> None:
        super().__init__(message)
        self.key = key


class Bounds(NamedTuple):
    """From the lowest to the highest value that is no mistake."""

    low: float
    high: float
    unit: str = ""

    def require(self, what: str, value: Any, *key: str) -> None:
        """Check one value.

        Raises:
            MapError: it is no number, not finite, or outside.
        """
        if not isinstance(value, Real) or isinstance(value, bool):
            raise MapError(f"{what} cannot be {value!r}, it is a number", *key)
        if not self.low <= float(value) <= self.high:
            unit = f" {self.unit}" if self.unit else ""
            raise MapError(f"{what} {value:g} is not in {self.low:g}…{self.high:g}{unit}", *key)


def within(low: float, high: float, unit: str = "") -> Mapping[str, Bounds]:
    """The metadata of a dataclass' field that is to keep within bounds; `require_bounds` sees to it."""
    return {"bounds": Bounds(low, high, unit)}


def require_bounds(thing: Any, prefix: str = "") -> None:
    """Check every bounded field of a dataclass.

    Raises:
        MapError: one is no number, not finite, or outside its bounds.
    """
    for f in fields(thing):
        bounds: Bounds | None = f.metadata.get("bounds")
        if bounds is not None:
            bounds.require(prefix + f.name, getattr(thing, f.name), f.name)


STANDARD_GRAVITY = 9.80665
"""[m/s²], by definition."""
KINDS = ("opencr", "lines")
"""Connections of a sensor: over the servos' bus with OpenCR's protocol, or as lines of text on a separate port."""


@dataclass(frozen=True)
class Imu:
    """An inertial sensor that is fixed to the robot's root body.

    Defaults are the data sheet of the MPU-9250 on ROBOTIS's OpenCR; the accelerometer's bias is the rest after
    calibration.
    """

    kind: str = "opencr"
    id: int = field(default=200, metadata=within(0, 252))
    """Id on the servos' bus."""
    port: str = ""
    """Port of a sensor that is not on the servos' bus."""
    baud: int = field(default=115200, metadata=within(1200, 4_000_000, "baud"))
    """Baud rate of that port."""
    axes: tuple[str, ...] = ("x", "y", "z")
    """Mounting: the sensor's axes that point along the root body's x, y and z, such as `-x`."""
    delay: float = field(default=0.008, metadata=within(0, 0.1, "s"))
    """Time between a motion and its reading [s]."""
    gyro_noise: float = field(default=0.002, metadata=within(0, 1, "rad/s"))
    """Standard deviation [rad/s]."""
    gyro_bias: float = field(default=0.087, metadata=within(0, 1, "rad/s"))
    """Largest reading at rest [rad/s]."""
    gyro_range: float = field(default=34.9, metadata=within(0.1, 100, "rad/s"))
    """Readings saturate here [rad/s]."""
    accel_noise: float = field(default=0.08, metadata=within(0, 10, "m/s²"))
    """Standard deviation [m/s²]."""
    accel_bias: float = field(default=0.1, metadata=within(0, 10, "m/s²"))
    """Largest error at rest [m/s²]."""
    accel_range: float = field(default=2 * STANDARD_GRAVITY, metadata=within(5, 1000, "m/s²"))
    """Readings saturate here [m/s²]."""

    def __post_init__(self) -> None:
        require_bounds(self, "imu: ")
        object.__setattr__(self, "axes", tuple(self.axes))
        if self.kind not in KINDS:
            raise MapError(f"imu: no kind {self.kind!r}; it has {', '.join(KINDS)}", "kind")
        if self.kind == "lines" and not self.port:
            raise MapError("imu: kind 'lines' needs a port", "kind")
        letters = [axis.lstrip("-") if isinstance(axis, str) else "" for axis in self.axes]
        if sorted(letters) != ["x", "y", "z"] or any(axis.count("-") > 1 for axis in self.axes):
            raise MapError(f"imu: axes {list(self.axes)!r} are not x, y and z, each once and with or without -", "axes")
        if np.linalg.det(self.mounting) < 0:
            raise MapError(f"imu: axes {list(self.axes)!r} are a mirror image of the sensor: flip one sign", "axes")

    @property
    def mounting(self) -> Floats:
        """(3, 3) rotation from the sensor's readings to the root body's axes."""
        rows = np.zeros((3, 3))
        for row, axis in zip(rows, self.axes, strict=True):
            row["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
        return rows


@dataclass(frozen=True)
class JointGain:
    """The response of one joint to a lean; positive gains turn the trunk upright about a standing foot."""

    rate: float = field(default=0.0, metadata=within(-1, 1, "s"))
    """Added angle per excess speed of the trunk [s]."""
    tilt: float = field(default=0.0, metadata=within(-5, 5))
    """Added angle per excess tilt of the trunk."""

    def __post_init__(self) -> None:
        require_bounds(self)


@dataclass(frozen=True)
class Balance:
    """Gains and bounds of the feedback. A gain of 0 disables its part."""

    joints: Mapping[str, JointGain] = field(default_factory=dict)
    """Gains by joint."""
    bound: float = field(default=0.2, metadata=within(0, 1, "rad"))
    """Largest angle that the feedback adds to a goal [rad]: 15 times the 0.013 measured in 17 clips of the OP3."""
    speed: float = field(default=3.0, metadata=within(0.05, 20, "rad/s"))
    """Largest rate of this angle [rad/s]: `bound` in 67 ms, about the 57 ms by which an XM430 follows."""
    fusion: float = field(default=1.0, metadata=within(0.05, 60, "s"))
    """Time constant with which the accelerometer corrects the gyroscope's tilt [s]."""
    fade: float = field(default=0.3, metadata=within(0.01, 5, "s"))
    """Duration of the fade-in at the start, and of the fade-out after a sensor fault [s]: five times the 57 ms of an XM430."""
    stop_roll: float = field(default=0.5, metadata=within(0.05, 1.6, "rad"))
    """In roll ..."""
    stop_pitch: float = field(default=0.5, metadata=within(0.05, 1.6, "rad"))
    """... and in pitch: with a larger excess tilt the robot is falling: it crouches and stops [rad]. Twice the 0.25 rad at which the OP3's centre of mass,
    0.254 m high, is over the edge of its soles of 0.127 m."""

    def __post_init__(self) -> None:
        require_bounds(self, "balance: ")
        joints = {joint: _gain(joint, entry) for joint, entry in dict(self.joints).items()}
        object.__setattr__(self, "joints", joints)


def _gain(joint: str, entry: Any) -> JointGain:
    if isinstance(entry, JointGain):
        return entry
    if not isinstance(entry, dict) or set(entry) - {"rate", "tilt"}:
        raise MapError(f"balance: {joint} cannot be {entry!r}; it is {{rate = …, tilt = …}}", "joints", joint)
    try:
        return JointGain(**entry)
    except MapError as error:
        raise MapError(f"balance: {joint}: {error}", "joints", joint) from None
