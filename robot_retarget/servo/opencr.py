"""ROBOTIS's OpenCR as the sensor board of an OP3: the registers of its inertial sensor on the servos' bus.

Addresses and units are those of ROBOTIS's `OPEN-CR.device` and `open_cr_module`: 2000/32800 °/s and 2/32768 g a unit.
"""

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Imu
from robot_retarget.actuators.inertial import Reading
from robot_retarget.base.arrays import Floats
from robot_retarget.servo import protocol
from robot_retarget.servo.bus import Bus

GYRO, ACCEL, ROLL, TABLE_END = 32, 38, 44, 51
"""Addresses: three words of angular velocity, three of acceleration, then roll, pitch and yaw."""
GYRO_UNIT = np.radians(2000.0 / 32800)
"""[rad/s]."""
ACCEL_UNIT = 2.0 / 32768 * STANDARD_GRAVITY
"""[m/s²]."""
SIZE = ROLL - GYRO
PATIENCE = 0.004
"""A reading that comes later than this is lost for the tick [s]."""


def encoded(reading: Reading, mounting: Floats) -> bytes:
    """The registers from `GYRO` on for a reading in the root body's axes."""
    words = [mounting.T @ reading.gyro / GYRO_UNIT, mounting.T @ reading.accel / ACCEL_UNIT]
    return np.clip(np.rint(np.concatenate(words)), -32768, 32767).astype("<i2").tobytes()


def decoded(data: bytes, mounting: Floats) -> Reading:
    """The reading, in the root body's axes, of `SIZE` bytes from `GYRO` on."""
    words = np.frombuffer(data[:SIZE], dtype="<i2").astype(float)
    return Reading(mounting @ words[:3] * GYRO_UNIT, mounting @ words[3:] * ACCEL_UNIT)


class OpenCr:
    """Reads an OpenCR on the servos' bus."""

    def __init__(self, bus: Bus, imu: Imu) -> None:
        self._bus, self._imu = bus, imu
        self._question = protocol.read(imu.id, GYRO, SIZE)

    def read(self) -> Reading | None:
        """The present reading, or None if no answer came in time."""
        data = self._bus.try_read(self._question, self._imu.id, SIZE, PATIENCE)
        return None if data is None else decoded(data, self._imu.mounting)
