"""Readers of inertial sensors. A new kind of sensor is one class with `read`, and one line in `open_sensor`.

`LineSensor` reads any board that prints lines of six numbers. A BNO08x, as on ToddlerBot, needs no class of its own: a
microcontroller prints its calibrated gyroscope and accelerometer in this form, or a class wraps its driver:

    class Bno08x:
        def __init__(self, driver, imu): self._driver, self._imu = driver, imu
        def read(self): return Reading(self._imu.mounting @ self._driver.gyro, self._imu.mounting @ self._driver.acceleration)
"""

from typing import Protocol

import numpy as np
import serial

from robot_retarget.actuators.balance_tables import Imu
from robot_retarget.actuators.inertial import Reading
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.opencr import OpenCr


class Sensor(Protocol):
    """An inertial sensor."""

    def read(self) -> Reading | None:
        """The present reading in the root body's axes, or None if there is no new one."""
        ...


class LineSensor:
    """A serial port with a line of six numbers for each reading: gyroscope x y z [rad/s], accelerometer x y z [m/s²].

    Raises:
        ServoError: the port cannot be opened.
    """

    def __init__(self, imu: Imu) -> None:
        self._imu, self._pending = imu, b""
        try:
            self._port = serial.Serial(imu.port, imu.baud, timeout=0, exclusive=True)
        except (OSError, serial.SerialException) as error:
            raise ServoError(f"cannot open the inertial sensor's port {imu.port}: {error}") from error

    def read(self) -> Reading | None:
        """The newest whole line that has come since the last call."""
        try:
            *lines, self._pending = (self._pending + self._port.read(4096)).split(b"\n")
        except (OSError, serial.SerialException):
            return None
        found = [reading for line in lines if (reading := self._parsed(line)) is not None]
        return found[-1] if found else None

    def _parsed(self, line: bytes) -> Reading | None:
        try:
            numbers = np.array([float(word) for word in line.replace(b",", b" ").split()])
        except ValueError:
            return None
        if numbers.shape != (6,) or not np.isfinite(numbers).all():
            return None
        return Reading(self._imu.mounting @ numbers[:3], self._imu.mounting @ numbers[3:])


def open_sensor(bus: Bus, imu: Imu) -> Sensor:
    """The reader of a map's sensor.

    Raises:
        ServoError: its port cannot be opened.
    """
    return OpenCr(bus, imu) if imu.kind == "opencr" else LineSensor(imu)
