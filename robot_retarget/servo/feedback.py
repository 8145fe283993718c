"""The feedback law on servos: the sensor is checked at rest, read at every tick, and no longer trusted once it is at fault."""

import time
from collections.abc import Callable

from robot_retarget.actuators.balance_tables import Balance, Imu
from robot_retarget.actuators.feedback import Feedback, Law
from robot_retarget.actuators.inertial import LeanTest, Reading, rest_faults
from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.fall import FallGuard
from robot_retarget.servo.outcome import FaultError
from robot_retarget.servo.plan import ServoPlan
from robot_retarget.servo.sensor import Sensor

SAMPLES = 50
"""Readings of the check at rest ..."""
SPACING = 0.004
"""... and the time between two of them [s]."""
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

    law: Law

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
