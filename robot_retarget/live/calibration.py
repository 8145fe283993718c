"""What a performer is like, kept in a file: the frames that a stream was calibrated by."""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.errors import MotionError
from robot_retarget.files import replacing
from robot_retarget.motion import Motion, Skeleton

KEYS = ("names", "parents", "offsets", "positions", "fps")
"""Of the file; `rotations` besides, where there are some."""


def keep(motion: Motion, path: str | Path) -> None:
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


def kept(path: str | Path) -> Motion:
    """A calibration as `keep` wrote it.

    Raises:
        MotionError: it cannot be read, or is none.
    """
    try:
        with np.load(path, allow_pickle=False) as found:
            values = {name: found[name] for name in found.files}
    except (OSError, ValueError, EOFError) as error:
        raise MotionError(f"cannot be read as a calibration: {error}", path) from error
    lacking = [key for key in KEYS if key not in values]
    if lacking:
        raise MotionError(f"is no calibration: it has no {lacking[0]!r}", path)
    skeleton = Skeleton(tuple(map(str, values["names"])), values["parents"], values["offsets"])
    return Motion(skeleton, values["positions"], values.get("rotations"), float(values["fps"]), str(path))
