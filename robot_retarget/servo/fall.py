"""A fall stops a motion: at every tick the inertial sensor's vertical is compared with the planned one."""

from collections.abc import Callable

import numpy as np

from robot_retarget.actuators.balance_tables import Balance, Imu
from robot_retarget.actuators.feedback import Fusion
from robot_retarget.actuators.inertial import Monitor, Reading, rest_faults
from robot_retarget.base.arrays import Floats
from robot_retarget.servo.outcome import FaultError
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.sensor import Sensor


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
        """Check the readings of the approach, and subtract the gyroscope's bias from later readings."""
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
