"""Save and load the calibration frames of a performer."""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import MotionError
from robot_retarget.base.files import replacing
from robot_retarget.base.untrusted.arrays import Field, read_fields
from robot_retarget.human.motion import Motion
from robot_retarget.human.skeleton import Skeleton

FARTHEST = 1000.0
"""A joint farther from the origin is a mistake [m]."""
FIELDS = {
    "names": Field("text", ("J",)),
    "parents": Field("integer", ("J",), bounds=(-1, np.inf)),
    "offsets": Field("number", ("J", 3), (-FARTHEST, FARTHEST)),
    "positions": Field("number", ("T", "J", 3), (-FARTHEST, FARTHEST)),
    "fps": Field("number", bounds=(1, 1000)),
    "rotations": Field("number", ("T", "J", 4), (-1.01, 1.01), required=False),
}
"""Of the file."""


def save_calibration(motion: Motion, path: str | Path) -> None:
    """Write a calibration, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    skeleton = motion.skeleton
    arrays: dict[str, Any] = {
        "names": np.array(skeleton.names), "parents": skeleton.parents, "offsets": skeleton.offsets,
        "positions": motion.positions, "fps": np.array(motion.fps),
    }  # fmt: skip
    arrays |= {} if motion.rotations is None else {"rotations": motion.rotations}
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_calibration(path: str | Path) -> Motion:
    """Read a calibration that `save_calibration` wrote.

    Raises:
        MotionError: The file cannot be read, or is not a calibration.
    """
    values = read_fields(path, FIELDS, MotionError)
    if "rotations" in values and not np.allclose(np.linalg.norm(values["rotations"], axis=-1), 1, atol=0.01):
        raise MotionError("rotations must be unit quaternions", path)
    skeleton = Skeleton(tuple(values["names"].tolist()), values["parents"], values["offsets"])
    return Motion(skeleton, values["positions"], values.get("rotations"), float(values["fps"]), str(path))
