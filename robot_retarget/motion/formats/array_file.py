"""NumPy's files, `.npy` and `.npz`, read without pickle and within a limit."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from robot_retarget.errors import MotionError, TrajectoryError
from robot_retarget.unpack import BROKEN, Archive, Head, load_npz, read_head

LARGEST = 512 << 20
"""Of one array [bytes]: an hour of 150 joints at 60 frames a second takes half of it."""

FPS_KEYS = ("fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")


def arrays_of(path: Path) -> Mapping[str, np.ndarray]:
    """The arrays of an `.npz` by name, each read on first access; an `.npy` is called `positions`.

    Raises:
        MotionError: the file is missing, holds only pickles, or an array is larger than `LARGEST`.
    """
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"PK"
        arrays = load_npz(path) if packed else _plain(path)
    except TrajectoryError as error:
        raise MotionError(str(error).removeprefix(f"{path}: "), path) from error
    except BROKEN as error:
        raise MotionError(f"not an array file that numpy reads without pickle: {error}", path) from error
    if not arrays:
        raise MotionError("holds no array that numpy reads without pickle", path)
    if isinstance(arrays, Archive):
        for name, head in arrays.heads.items():
            _require_bounded(name, head, path)
    return arrays


def _plain(path: Path) -> dict[str, np.ndarray]:
    """The array of an `.npy`, of the size that its head states.

    Raises:
        ValueError: it has another size, or is a pickle.
    """
    with path.open("rb") as file:
        head = read_head(file)
        stated, there = math.prod(head.shape) * head.dtype.itemsize, path.stat().st_size - file.tell()
        if stated != there and not head.dtype.hasobject:
            raise ValueError(f"it states {stated} bytes {head.shape}, and holds {there}")
        _require_bounded("positions", head, path)
        file.seek(0)
        return {"positions": np.lib.format.read_array(file, allow_pickle=False)}


def _require_bounded(name: str, head: Head, path: Path) -> None:
    size = math.prod(head.shape) * head.dtype.itemsize
    if size > LARGEST:
        raise MotionError(
            f"array {name!r} {head.shape} takes {size >> 20} MB, more than {LARGEST >> 20} MB: cut the motion", path
        )


def shape_of(path: Path) -> tuple[int, ...]:
    """The shape of an `.npy`, by its head; empty for any other file."""
    try:
        with path.open("rb") as file:
            return read_head(file).shape
    except BROKEN:
        return ()


def stored_rate(stored: np.ndarray | None, path: Path) -> float | None:
    """Frames per second as a file stores them.

    Raises:
        MotionError: not one positive number.
    """
    if stored is None:
        return None
    if stored.size != 1 or stored.dtype.kind not in "fiu" or not 0 < stored.item() < np.inf:
        raise MotionError(f"frames per second must be one positive number, got {stored}", path)
    return float(stored.item())
