"""The frame rate of a file, under the names that programs give it."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from robot_retarget.errors import TrajectoryError

RATE_KEYS = ("fps", "motion_fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate", "frequency")
"""Names of frames per second."""


def rate_of(table: Mapping[str, Any]) -> float | None:
    """Frames per second; None where no key states them.

    Raises:
        TrajectoryError: they are not one number.
    """
    key = next((key for key in RATE_KEYS if key in table), None)
    if key is None:
        return None
    value = np.asarray(table[key])
    if value.size != 1 or value.dtype.kind not in "fiu":
        raise TrajectoryError(f"{key} must be one number, got {value.dtype} {value.shape}")
    return float(value.reshape(-1)[0])
