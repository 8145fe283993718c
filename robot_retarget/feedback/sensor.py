"""An inertial sensor that is not real: what a body does becomes readings with noise, bias, range, rounding and delay."""

from collections import deque
from dataclasses import replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.feedback.reading import Reading
from robot_retarget.feedback.tables import Imu


class BodyMotion:
    """Angular velocity and specific force of a body from its states, one after the other.

        f = Rᵀ ((v − v') / dt − g)

    Args:
        gravity: (3,) g in the world's axes [m/s²]; on a tilted floor it tilts against the world's vertical.
    """

    def __init__(self, gravity: Floats) -> None:
        self._gravity = np.array(gravity)
        self._velocity: Floats | None = None

    def reading(self, quaternion: Floats, velocity: Floats, spin: Floats, dt: float) -> Reading:
        """A perfect reading.

        Args:
            quaternion: (4,) of the body, wxyz.
            velocity: (3,) in the world's axes [m/s].
            spin: (3,) angular velocity in the body's axes [rad/s].
            dt: since the state before [s].
        """
        change = np.zeros(3) if self._velocity is None else (velocity - self._velocity) / dt
        self._velocity = velocity.copy()
        return Reading(spin.copy(), _into_body(quaternion, change - self._gravity))


class VirtualImu:
    """Makes readings as a sensor of a data sheet would.

    Args:
        imu: noise, bias, range and delay.
        dt: between two readings [s].
        seed: of noise and bias.
    """

    def __init__(self, imu: Imu, dt: float, seed: int = 0) -> None:
        self._imu, self._random = imu, np.random.default_rng(seed)
        self._gyro_bias, self._accel_bias = self._random.uniform(-1, 1, (2, 3)) * [[imu.gyro_bias], [imu.accel_bias]]
        self._late: deque[Reading] = deque(maxlen=round(imu.delay / dt) + 1)

    def read(self, true: Reading) -> Reading:
        """The reading for a perfect one (both in the root body's axes)."""
        imu, noise = self._imu, self._random.standard_normal((2, 3))
        gyro = true.gyro + self._gyro_bias + imu.gyro_noise * noise[0]
        accel = true.accel + self._accel_bias + imu.accel_noise * noise[1]
        self._late.append(
            Reading(np.clip(gyro, -imu.gyro_range, imu.gyro_range), np.clip(accel, -imu.accel_range, imu.accel_range))
        )
        return self._late[0]


def calibrated(imu: Imu) -> Imu:
    """The same sensor once its gyroscope's bias is taken off, as the check before a motion does."""
    return replace(imu, gyro_bias=0.0)


def _into_body(quaternion: Floats, vector: Floats) -> Floats:
    """Rᵀ v."""
    w, axis = quaternion[0], -quaternion[1:]
    cross = 2 * np.cross(axis, vector)
    return vector + w * cross + np.cross(axis, cross)
