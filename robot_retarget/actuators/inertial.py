"""Inertial sensors: readings, a simulated sensor, fault checks, and the test lean before a motion."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Imu
from robot_retarget.base.arrays import Floats, cross, minimum_jerk

# The readings of an inertial sensor: angular velocity and specific force, in the axes of the robot's root body.


class Reading(NamedTuple):
    """One reading."""

    gyro: Floats
    """(3,) angular velocity [rad/s]."""
    accel: Floats
    """(3,) acceleration minus gravity [m/s²]: +g along the vertical at rest."""

    @property
    def finite(self) -> bool:
        """Whether all six numbers are finite; the state of a law never recovers from one that is not."""
        return bool(np.isfinite(self.gyro).all() and np.isfinite(self.accel).all())


LEVEL = Reading(np.zeros(3), np.array([0.0, 0.0, STANDARD_GRAVITY]))
"""The reading of a level body at rest."""


def tilt_of(up: Floats) -> Floats:
    """Return roll and pitch (..., 2) [rad] of a body in which the vertical points along `up` (..., 3)."""
    roll = np.arctan2(up[..., 1], up[..., 2])
    pitch = -np.arctan2(up[..., 0], np.hypot(up[..., 1], up[..., 2]))
    return np.stack([roll, pitch], axis=-1)


def vertical_in(quaternions: Floats) -> Floats:
    """Return (..., 3) the vertical in the axes of bodies with rotations (..., 4), unit, wxyz: the last row of R."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1)


# A simulated inertial sensor: the motion of a body becomes readings with noise, bias, range, rounding and delay.


class BodyMotion:
    """Compute angular velocity and specific force of a body from its consecutive states.

        f = Rᵀ ((v − v') / dt − g)

    Args:
        gravity: (3,) g in the world's axes [m/s²]; on a tilted floor it tilts against the world's vertical.
    """

    def __init__(self, gravity: Floats) -> None:
        self._gravity = np.array(gravity)
        self._velocity: Floats | None = None

    def reading(self, quaternion: Floats, velocity: Floats, spin: Floats, dt: float) -> Reading:
        """Return a perfect reading.

        Args:
            quaternion: (4,) rotation of the body, wxyz.
            velocity: (3,) velocity in the world's axes [m/s].
            spin: (3,) angular velocity in the body's axes [rad/s].
            dt: time since the state before [s].
        """
        change = np.zeros(3) if self._velocity is None else (velocity - self._velocity) / dt
        self._velocity = velocity.copy()
        return Reading(spin.copy(), _into_body(quaternion, change - self._gravity))


class VirtualImu:
    """Make the readings of a sensor with a data sheet.

    Args:
        imu: noise, bias, range and delay.
        dt: time between two readings [s].
        seed: seed of noise and bias.
    """

    def __init__(self, imu: Imu, dt: float, seed: int = 0) -> None:
        self._imu, self._random = imu, np.random.default_rng(seed)
        self._gyro_bias, self._accel_bias = self._random.uniform(-1, 1, (2, 3)) * [[imu.gyro_bias], [imu.accel_bias]]
        self._late: deque[Reading] = deque(maxlen=round(imu.delay / dt) + 1)

    def read(self, true: Reading) -> Reading:
        """Return the reading for a perfect one (both in the root body's axes)."""
        imu, noise = self._imu, self._random.standard_normal((2, 3))
        gyro = true.gyro + self._gyro_bias + imu.gyro_noise * noise[0]
        accel = true.accel + self._accel_bias + imu.accel_noise * noise[1]
        self._late.append(
            Reading(np.clip(gyro, -imu.gyro_range, imu.gyro_range), np.clip(accel, -imu.accel_range, imu.accel_range))
        )
        return self._late[0]


def calibrated(imu: Imu) -> Imu:
    """Return the same sensor without its gyroscope's bias, which the check before a motion removes."""
    return replace(imu, gyro_bias=0.0)


def _into_body(quaternion: Floats, vector: Floats) -> Floats:
    """Return Rᵀ v."""
    w, axis = quaternion[0], -quaternion[1:]
    turned = 2 * cross(axis, vector)
    return vector + w * turned + cross(axis, turned)


# Fault checks of an inertial sensor: before a motion at rest, and at every tick.

FROZEN = 0.05
"""A sensor without a new reading, or with the same one, for this time is at fault [s]: six ticks at the 125 a second of `goals.RATE`."""
WEIGHT = 0.15
"""At rest the accelerometer measures gravity within this share: the data sheet of an MPU-9250 allows an offset of 0.08 g and
an error of scale of 0.03."""
NOISY = 5.0
"""Noise above this multiple of the data sheet's standard deviation is a fault."""
STRAY = 0.35
"""Largest lean of the trunk from the plan at rest, floor and bias together [rad]: 20°, between the 3° of a floor and the 90° of exchanged axes."""


LYING = 0.5
"""A vertical that points along the body's own axis by less than this has fallen [-]: by definition 60°, nearer to lying than to standing."""
SIDES = ("its back", "its right side", "its feet"), ("its front", "its left side", "its head")
"""The side on which a body lies while its axis x, y or z points up, and down."""


class Monitor:
    """Check readings tick by tick."""

    def __init__(self, imu: Imu, dt: float) -> None:
        self._imu, self._dt = imu, dt
        self._last: Reading | None = None
        self._same = self._saturated = 0.0

    def step(self, reading: Reading | None) -> str | None:
        """Take the reading of a tick, and return the fault that has lasted for `FROZEN` until now, or None."""
        same = reading is None or (self._last is not None and np.array_equal(np.array(reading), np.array(self._last)))
        self._same = self._same + self._dt if same else 0.0
        if reading is not None:
            full = np.abs(reading.gyro).max() >= 0.99 * self._imu.gyro_range
            self._saturated, self._last = self._saturated + self._dt if full else 0.0, reading
        if self._same >= FROZEN:
            return f"the inertial sensor {'does not answer' if reading is None else 'gives the same reading'}"
        return "the gyroscope is saturated" if self._saturated >= FROZEN else None


def fallen(readings: Sequence[Reading]) -> str | None:
    """Return on which side a robot lies that should stand, and how to begin again; None for one that stands or falls freely.

    The direction of gravity shows this for a robot that moves a little too.
    """
    force = np.mean([reading.accel for reading in readings], axis=0) if readings else np.zeros(3)
    weight = float(np.linalg.norm(force))
    if weight < STANDARD_GRAVITY / 2 or force[2] > LYING * weight:
        return None
    axis = int(np.abs(force).argmax())
    return (
        f"the robot lies on {SIDES[int(force[axis] < 0)][axis]}: set it on its feet, or start its emulator again, and play again; "
        "if it stands, look over the axes of [imu]"
    )


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
    lies = fallen(readings) if planned is None or np.cos(planned).min() > LYING else None
    if lies:
        return [lies]
    faults = []
    bias, weight = np.abs(gyro.mean(axis=0)), float(np.linalg.norm(accel.mean(axis=0)))
    if (bias > imu.gyro_bias + 3 * imu.gyro_noise).any():
        axis = "xyz"[int(bias.argmax())]
        faults.append(
            f"the gyroscope turns by {bias.max():.2g} rad/s about {axis} at rest, {imu.gyro_bias:g} is its bias"
        )
    if abs(weight / STANDARD_GRAVITY - 1) > WEIGHT:
        falls = "; or the robot falls freely, without a floor under it" if weight < STANDARD_GRAVITY / 2 else ""
        faults.append(f"the accelerometer gives {weight:.3g} m/s² at rest: wrong units or range{falls}")
    for what, values, noise in (("gyroscope", gyro, imu.gyro_noise), ("accelerometer", accel, imu.accel_noise)):
        if still and values.std(axis=0).max() > NOISY * noise > 0:
            faults.append(f"the {what}'s noise is {values.std(axis=0).max():.2g}, its data sheet's {noise:g}")
    if planned is not None and not faults:
        off = tilt_of(accel.mean(axis=0)) - planned
        if np.abs(off).max() > STRAY:
            which = ("roll", "pitch")[int(np.abs(off).argmax())]
            faults.append(f"{which} is {np.abs(off).max():.2g} rad from the pose's: look over the axes of [imu]")
    return faults


# A test lean before a motion: the robot leans a little to its right and ahead, and its sensor must measure that.
#
#     q(t) = q₀ + L s(t) θ,      L from δq_legs = −J_legs⁺ J_root δroot        the feet stay, the root body turns about its origin
#
# A sensor that is turned, has a wrong sign or exchanged axes measures another lean than the model predicts.

LEAN = 0.06
"""Lean of the trunk [rad]: 3.4°, 30 times the error of a mean over `HELD` with the data sheet's noise."""
RISE = 0.5
"""Duration of a lean, and of the way back [s]: the fastest turn is 0.23 rad/s."""
REST = 0.5
"""The first pose is held for this time before: an emulated robot is released after 0.3 s at rest [s]."""
HELD = 0.2
"""A lean is held for this time, in which the accelerometer is averaged [s]: the noise of a mean of 25 readings, at the 125 a second of `goals.RATE`, is a fifth."""
PART = 0.5
"""A lean is measured from this part of it on; more about the other axis is a fault. Fewer readings than this are silence."""
LATE_READING = 0.12
"""Readings later than this after the goals plus the sensor's own delay are a fault [s]: servos lag by 0.05 to 0.07 s."""
LONGEST_LAG = 0.3
"""Lags up to this are looked for [s]: over four times the 0.07 s of servos, so that a late sensor is found and named."""
AXES = ("roll", "pitch")


class LeanTest:
    """Goals of a test lean, and a check of the readings.

    Args:
        first: (n,) the first pose [rad].
        lean: (n, 2) change of the joints per roll and pitch of the root body [-].
        rate: ticks a second [1/s].
        delay: of the sensor, as its data sheet states it [s].
    """

    def __init__(self, first: Floats, lean: Floats, rate: float, delay: float = 0.0) -> None:
        shape, self._rest = _there_and_back(rate), round(REST * rate)
        leans = np.concatenate([LEAN * shape[:, None] * lean[:, axis] for axis in range(2)])
        self.goals: Floats = first + np.concatenate([np.zeros((self._rest, len(first))), leans])
        """(N, n) goals [rad]."""
        self.possible: bool = bool(lean.any())
        """Whether the feet are known."""
        self._rate, self._top, self._delay = rate, np.flatnonzero(shape == 1.0), delay
        self._spin = LEAN * np.gradient(shape) * rate
        self._readings = np.full((len(self.goals), 2, 3), np.nan)

    def note(self, tick: int, reading: Reading | None) -> None:
        """Keep the reading of a tick."""
        if reading is not None:
            self._readings[tick] = reading

    def faults(self) -> list[str]:
        """Return the differences between the readings and the lean."""
        rest, leans = self._readings[self._rest // 2 : self._rest], self._readings[self._rest :]
        if np.isnan(rest).all() or np.isnan(leans).mean() > PART:
            return ["the inertial sensor does not answer during the test lean"]
        spin, force = np.nanmean(rest, axis=0)
        found = []
        for axis, readings in enumerate(np.split(leans, 2)):
            tilt = tilt_of(np.nanmean(readings[self._top, 1], axis=0)) - tilt_of(force)
            turned = np.nancumsum(readings[:, 0, :2] - spin[:2], axis=0)[self._top[len(self._top) // 2]] / self._rate
            found += _faults("accelerometer", axis, tilt) + _faults("gyroscope", axis, turned)
        late = self._lag(leans, spin) - self._delay
        if not found and late > LATE_READING:
            found.append(
                f"the inertial sensor measures the test lean {late:.2f} s late: its delay is not that of [imu]"
            )
        return found

    def _lag(self, leans: Floats, spin: Floats) -> float:
        """Return the lag [s] at which the gyroscope agrees best with the planned speeds of both leans."""
        measured = np.concatenate([part[:, 0, axis] - spin[axis] for axis, part in enumerate(np.split(leans, 2))])
        planned, heard = np.tile(self._spin, 2), np.nan_to_num(measured)
        lags = range(round(LONGEST_LAG * self._rate) + 1)
        return float(np.argmax([heard[k:] @ planned[: len(planned) - k] for k in lags])) / self._rate


def _there_and_back(rate: float) -> Floats:
    """(N,) from 0 to 1 and back on minimum-jerk paths, held at the top and at the end."""
    up = minimum_jerk(np.linspace(0.0, 1.0, round(RISE * rate) + 1))
    held = round(HELD * rate)
    return np.concatenate([up, np.ones(held), up[::-1], np.zeros(held)])


def _faults(sensor: str, axis: int, measured: Floats) -> list[str]:
    """Faults of a sensor that measured a lean (2,) [rad] where one about an axis was made."""
    along, across = measured[axis] / LEAN, measured[1 - axis] / LEAN
    name, other = AXES[axis], AXES[1 - axis]
    if along < -PART:
        return [f"the {sensor} measures the test lean with the wrong sign: {name} is reversed"]
    if abs(across) > PART:
        return [f"the {sensor} measures {other} where the robot leans in {name}"]
    if along < PART:
        return [f"the {sensor} measures {LEAN * along:.3f} rad of the test lean of {LEAN:g} rad in {name}"]
    return []
