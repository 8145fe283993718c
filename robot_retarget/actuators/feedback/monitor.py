"""Fault checks of an inertial sensor: before a motion at rest, and at every tick."""

from collections.abc import Sequence

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Imu
from robot_retarget.actuators.feedback.reading import Reading, tilt_of
from robot_retarget.base.arrays import Floats

FROZEN = 0.05
"""A sensor without a new reading, or with the same one, for this time is at fault [s]."""
WEIGHT = 0.15
"""At rest the accelerometer measures gravity within this share."""
NOISY = 5.0
"""Noise above this multiple of the data sheet's standard deviation is a fault."""
STRAY = 0.35
"""Largest lean of the trunk from the plan at rest, floor and bias together [rad]."""


class Monitor:
    """Check readings tick by tick."""

    def __init__(self, imu: Imu, dt: float) -> None:
        self._imu, self._dt = imu, dt
        self._last: Reading | None = None
        self._same = self._saturated = 0.0

    def step(self, reading: Reading | None) -> str | None:
        """Take the reading of a tick, and return the fault that has lasted for `FROZEN` until now, or None."""
        same = reading is None or (self._last is not None and _equal(reading, self._last))
        self._same = self._same + self._dt if same else 0.0
        if reading is not None:
            full = np.abs(reading.gyro).max() >= 0.99 * self._imu.gyro_range
            self._saturated = self._saturated + self._dt if full else 0.0
            silent, self._last = False, reading
        else:
            silent = True
        if self._same >= FROZEN:
            return "the inertial sensor does not answer" if silent else "the inertial sensor gives the same reading"
        return "the gyroscope is saturated" if self._saturated >= FROZEN else None


def rest_faults(readings: Sequence[Reading], imu: Imu, planned: Floats | None = None, still: bool = True) -> list[str]:
    """Return the faults in readings of a robot at rest.

    Args:
        planned: the root body's roll and pitch (2,) [rad]; None leaves the mounting unchecked.
        still: whether the robot does not move at all, so that readings show the sensor's noise.
    """
    if not readings:
        return ["the inertial sensor does not answer"]
    gyro, accel = (np.array([getattr(r, name) for r in readings]) for name in ("gyro", "accel"))
    if len(readings) > 2 and not np.ptp(gyro, axis=0).any() and not np.ptp(accel, axis=0).any():
        return ["the inertial sensor is frozen: all readings are the same"]
    faults = []
    bias, weight = np.abs(gyro.mean(axis=0)), float(np.linalg.norm(accel.mean(axis=0)))
    if (bias > imu.gyro_bias + 3 * imu.gyro_noise).any():
        axis = "xyz"[int(bias.argmax())]
        faults.append(
            f"the gyroscope turns by {bias.max():.2g} rad/s about {axis} at rest, {imu.gyro_bias:g} is its bias"
        )
    if abs(weight / STANDARD_GRAVITY - 1) > WEIGHT:
        faults.append(f"the accelerometer gives {weight:.3g} m/s² at rest: wrong units or range")
    for what, values, noise in (("gyroscope", gyro, imu.gyro_noise), ("accelerometer", accel, imu.accel_noise)):
        if still and values.std(axis=0).max() > NOISY * noise > 0:
            faults.append(f"the {what}'s noise is {values.std(axis=0).max():.2g}, its data sheet's {noise:g}")
    if planned is not None and not faults:
        off = tilt_of(accel.mean(axis=0)) - planned
        if np.abs(off).max() > STRAY:
            which = ("roll", "pitch")[int(np.abs(off).argmax())]
            faults.append(f"{which} is {np.abs(off).max():.2g} rad from the pose's: look over the axes of [imu]")
    return faults


def _equal(one: Reading, other: Reading) -> bool:
    return bool((one.gyro == other.gyro).all() and (one.accel == other.accel).all())
