"""The inertial sensor during playback: its readers, the stop after a fall, and the feedback law."""

import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
import serial

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Balance, Imu
from robot_retarget.actuators.feedback import Feedback, Fusion, Law
from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.inertial import LYING, LeanTest, Monitor, Reading, fallen, rest_faults
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.servo import protocol
from robot_retarget.servo.bus import Bus
from robot_retarget.servo.outcome import FaultError
from robot_retarget.servo.plan import ServoPlan

# ROBOTIS's OpenCR as the sensor board of an OP3: the registers of its inertial sensor on the servos' bus.
#
# Addresses and units are those of ROBOTIS's `OPEN-CR.device` and `open_cr_module`: 2000/32800 °/s and 2/32768 g a unit.

GYRO, ACCEL, ROLL, TABLE_END = 32, 38, 44, 51
"""Addresses: three words of angular velocity, three of acceleration, then roll, pitch and yaw."""
GYRO_UNIT = np.radians(2000.0 / 32800)
"""[rad/s]."""
ACCEL_UNIT = 2.0 / 32768 * STANDARD_GRAVITY
"""[m/s²]."""
SIZE = ROLL - GYRO
SENSOR_PATIENCE = 0.5 / RATE
"""A reading that comes later than this is lost for the tick [s]: half of a tick."""


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
        data = self._bus.try_read(self._question, self._imu.id, SIZE, SENSOR_PATIENCE)
        return None if data is None else decoded(data, self._imu.mounting)


# Readers of inertial sensors. A new kind of sensor is one class with `read`, and one line in `open_sensor`.
#
# `LineSensor` reads any board that prints lines of six numbers. A BNO08x, as on ToddlerBot, needs no separate class: a
# microcontroller prints its calibrated gyroscope and accelerometer in this form, or a class wraps its driver:
#
#     class Bno08x:
#         def __init__(self, driver, imu): self._driver, self._imu = driver, imu
#         def read(self): return Reading(self._imu.mounting @ self._driver.gyro, self._imu.mounting @ self._driver.acceleration)


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


# A fall stops a motion: at every tick the inertial sensor's vertical is compared with the planned one.


class FallGuard:
    """Stops a motion without feedback when the trunk leans too far from the plan.

    A sensor at fault is noted and no longer read.

    Args:
        plan: gives the planned vertical and the rate.
        sensor: of the servo map.
        imu: its data sheet.
        balance: gives the largest lean and the filter's time constant.
        note: receives faults of the sensor.
    """

    def __init__(
        self, plan: ServoPlan, sensor: Sensor, imu: Imu, balance: Balance, note: Callable[[str], None]
    ) -> None:
        self._up, self._rate = plan.up, plan.rate
        self._sensor, self._imu, self._note = sensor, imu, note
        self._limit = min(balance.stop_roll, balance.stop_pitch)
        self._fusion, self._monitor = Fusion(balance.fusion), Monitor(imu, 1 / plan.rate)
        self._before: list[Reading] = []
        self._bias = np.zeros(3)
        self.trusted: bool = True
        """Whether the sensor is read."""

    def listen(self, target: Floats) -> Floats:
        """Take a reading on the way to a pose and return its target; on the way to the first, the trunk hardly moves."""
        reading = self._sensor.read() if self.trusted else None
        if reading is not None and reading.finite:
            self._before.append(reading)
            self._fusion.step(Reading(reading.gyro - self._bias, reading.accel), 1 / self._rate)
        return target

    def ready(self) -> None:
        """Check the readings of the approach, and subtract the gyroscope's bias from later readings.

        Raises:
            FaultError: the robot lies where the plan begins upright.
        """
        upright = self._up is None or self._up[0, 2] > LYING
        if upright and (lies := fallen(self._before)):
            raise FaultError(lies)
        faults = rest_faults(self._before, self._imu, still=False)
        if faults:
            self._lose("; ".join(faults))
        else:
            self._bias = np.mean([reading.gyro for reading in self._before], axis=0)

    def follow(self, plan: ServoPlan) -> None:
        """Compare with another plan from now on, a branch of the one before."""
        self._up = plan.up

    def goal(self, row: int, plan: Floats) -> Floats:
        """Return the goals (n,) of a tick [rad].

        Raises:
            FaultError: the robot fell.
        """
        self._read()
        self.require_upright(row)
        return plan

    def require_upright(self, row: int = -1) -> None:
        """Compare the measured vertical with that of a row; the last one by default.

        Raises:
            FaultError: the robot fell.
        """
        if self._up is None or self._fusion.up is None or not self.trusted:
            return
        planned = self._up[row]
        off = float(np.arccos(np.clip(self._fusion.up @ planned / np.linalg.norm(planned), -1.0, 1.0)))
        if off > self._limit:
            raise FaultError(
                f"the robot fell: its trunk is {off:.2f} rad from the plan (held by its pelvis: --mode pinned)"
            )

    def _read(self) -> Reading | None:
        """Return the present reading without bias, or None without a finite one."""
        if not self.trusted:
            return None
        reading = self._sensor.read()
        reading = reading if reading is not None and reading.finite else None
        fault = self._monitor.step(reading)
        if fault is not None:
            self._lose(fault)
        if reading is None or not self.trusted:
            return None
        reading = Reading(reading.gyro - self._bias, reading.accel)
        self._fusion.step(reading, 1 / self._rate)
        return reading

    def _lose(self, fault: str) -> None:
        self.trusted = False
        self._note(f"{fault}: a fall stops nothing")


# The feedback law on servos: the sensor is checked at rest, read at every tick, and no longer trusted once it is at fault.

SAMPLES = 50
"""Readings of the check at rest ..."""
SPACING = 0.004
"""... and the time between two of them [s]: 0.2 s in all, as `inertial.HELD`."""
CROUCHED = 2.0
"""Time after which a robot that leaned too far rests in its crouch [s]."""


def require_sound(sensor: Sensor, imu: Imu, lockstep: bool = False) -> None:
    """Check a sensor before anything moves. In lockstep time stands still until then: one reading says all.

    Raises:
        ServoError: the sensor does not answer, or its readings cannot be; all of it is said.
    """
    readings: list[Reading] = []
    for _ in range(SAMPLES):
        reading = sensor.read()
        if reading is not None:
            readings.append(reading)
        if lockstep and readings:
            break
        time.sleep(SPACING)
    if lies := fallen(readings):
        raise ServoError(lies)
    faults = rest_faults(readings, imu)
    if faults:
        raise ServoError(
            f"{'; '.join(faults)} (--no-feedback plays without it, once simulate --no-feedback has passed)"
        )


class Balancer(FallGuard):
    """The law during one playback.

    Args:
        feedback: of the plan, in the order of its joints.
    """

    def __init__(
        self,
        feedback: Feedback,
        plan: ServoPlan,
        sensor: Sensor,
        imu: Imu,
        balance: Balance,
        note: Callable[[str], None],
    ) -> None:
        super().__init__(plan, sensor, imu, balance, note)
        self.law, self._stopped = Law(feedback, 1 / plan.rate), 0

    def ready(self) -> None:
        """Compare the readings with the first pose, and subtract the gyroscope's bias from later readings.

        Raises:
            FaultError: the sensor is at fault, or mounted otherwise than the map says.
        """
        faults = rest_faults(self._before, self._imu, self.law.feedback.reference[0, :2], still=False)
        if faults:
            raise FaultError("; ".join(faults))
        super().ready()

    def test(self, first: Floats) -> LeanTest:
        """Return the test lean from the first pose (n,) [rad]."""
        return LeanTest(first, self.law.feedback.lean, self._rate, self._imu.delay)

    def lean(self, test: LeanTest, tick: int) -> None:
        """Take the reading of a tick of the test lean."""
        test.note(tick, self._sensor.read())

    def require_leant(self, test: LeanTest) -> None:
        """Compare the measured lean with the commanded one.

        Raises:
            FaultError: they differ.
        """
        faults = test.faults()
        if faults:
            raise FaultError(f"{'; '.join(faults)}: check the axes of [imu], and the signs of the legs' servos")

    def follow(self, plan: ServoPlan) -> None:
        """Compare with another plan from now on, a branch of the one before, by its own references."""
        super().follow(plan)
        assert plan.feedback is not None
        self.law.feedback = plan.feedback

    def goal(self, row: int, plan: Floats) -> Floats:
        """Return the goals (n,) of a tick [rad].

        Raises:
            FaultError: the robot leaned too far; by now it crouches.
        """
        goal = self.law.step(row, plan, self._read())
        self._stopped += self.law.stopped
        if self._stopped > CROUCHED * self._rate:
            self.require_upright(row)
        return goal

    def require_upright(self, row: int = -1) -> None:
        """Check that the law did not give up on a lean, and that the robot did not fall.

        Raises:
            FaultError: it did.
        """
        if self.law.stopped:
            raise FaultError("the robot leaned too far from the plan; it stopped in a crouch")
        super().require_upright(row)

    def _lose(self, fault: str) -> None:
        self.trusted = self.law.trusted = False
        self._note(f"{fault}: feedback fades out")
