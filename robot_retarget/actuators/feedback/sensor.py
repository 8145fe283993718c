"""A simulated inertial sensor: the motion of a body becomes readings with noise, bias, range, rounding and delay."""

from collections import deque
from dataclasses import replace

import numpy as np

from robot_retarget.actuators.balance_tables import Imu
from robot_retarget.actuators.feedback.reading import Reading
from robot_retarget.base.arrays import Floats, cross


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
