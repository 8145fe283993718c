"""The readings of an inertial sensor: angular velocity and specific force, in the axes of the robot's root body."""

from typing import NamedTuple

import numpy as np

from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY
from robot_retarget.base.arrays import Floats


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
