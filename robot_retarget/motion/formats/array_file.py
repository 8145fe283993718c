"""NumPy's files, `.npy` and `.npz`, read without pickle and within a limit."""

from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.errors import MotionError, TrajectoryError
from robot_retarget.unpack import BROKEN, load_npz

FPS_KEYS = ("fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")


def arrays_of(path: Path) -> dict[str, Any]:
    """The arrays of an `.npz` by name; an `.npy` is called `positions`. Arrays of objects, which are pickles, are left out.

    Raises:
        MotionError: no such file, only pickles in it, or more in it than a machine can hold.
    """
    try:
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                file.seek(0)
                return {"positions": np.lib.format.read_array(file, allow_pickle=False)}
        arrays = load_npz(path)
    except TrajectoryError as error:
        raise MotionError(str(error).removeprefix(f"{path}: "), path) from error
    except BROKEN as error:
        raise MotionError(f"not an array file that numpy reads without pickle: {error}", path) from error
    if not arrays:
        raise MotionError("holds no array that numpy reads without pickle", path)
    return arrays


def shape_of(path: Path) -> tuple[int, ...]:
    """The shape of an `.npy`, by its head; nothing where the file is none."""
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            head = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            return head(file)[0]
    except BROKEN:
        return ()


def stored_rate(stored: Any | None, path: Path) -> float | None:
    """Frames per second as a file stores them.

    Raises:
        MotionError: not one positive number.
    """
    if stored is None:
        return None
    if stored.size != 1 or stored.dtype.kind not in "fiu" or not 0 < stored.item() < np.inf:
        raise MotionError(f"frames per second must be one positive number, got {stored}", path)
    return float(stored.item())
