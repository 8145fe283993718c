"""Complementary filter: the gyroscope turns the vertical, the accelerometer pulls it slowly to where it really is.

    u' = u − (ω × u) dt,        u ← u' + (dt / T) w (a / ‖a‖ − u'),        w = max(0, 1 − |‖a‖ − g| / (g / 2))

A push or a step makes ‖a‖ differ from g and switches the correction off for as long.
"""

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY
from robot_retarget.actuators.inertial import Reading, tilt_of
from robot_retarget.base.arrays import Floats

TRUST = STANDARD_GRAVITY / 2
"""An acceleration that differs from gravity by this much says nothing about the vertical [m/s²]."""


class Fusion:
    """The vertical in the root body's axes, from reading to reading.

    Args:
        time_constant: of the accelerometer's pull [s].
    """

    def __init__(self, time_constant: float) -> None:
        self._time_constant = time_constant
        self.up: Floats | None = None
        """(3,) the measured vertical; None before the first reading."""

    def step(self, reading: Reading, dt: float) -> Floats:
        """Return roll and pitch (2,) [rad] after a reading, `dt` [s] after the one before."""
        size = float(np.sqrt(reading.accel @ reading.accel))
        felt = reading.accel / size if size > 1e-6 else np.array([0.0, 0.0, 1.0])
        if self.up is None:
            self.up = felt
        wx, wy, wz = reading.gyro
        x, y, z = self.up
        turned = self.up - dt * np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
        trust = max(0.0, 1.0 - abs(size - STANDARD_GRAVITY) / TRUST)
        up = turned + min(1.0, dt / self._time_constant) * trust * (felt - turned)
        self.up = up / np.sqrt(up @ up)
        return tilt_of(self.up)
