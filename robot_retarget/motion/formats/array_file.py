"""NumPy's files, `.npy` and `.npz`, read without pickle and within a limit."""

import io
import tokenize
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from robot_retarget.errors import MotionError

FPS_KEYS = ("fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate")
LARGEST = 4 * 2**30
"""Of an array once it is unpacked; an hour of a body with fingers at 120 frames a second is 0.5 GB [bytes]."""
BROKEN = (ValueError, EOFError, BadZipFile, NotImplementedError, OverflowError, zlib.error, tokenize.TokenError)
"""What Python's readers raise at bytes that are no archive, or no array."""


def arrays_of(path: Path) -> dict[str, Any]:
    """The arrays of an `.npz` by name; an `.npy` is called `positions`. Arrays of objects, which are pickles, are left out.

    Raises:
        MotionError: no such file, only pickles in it, or arrays larger than `LARGEST`.
    """
    try:
        with path.open("rb") as file:
            if file.read(2) == b"PK":
                return _members(path)
            file.seek(0)
            return {"positions": np.lib.format.read_array(file, allow_pickle=False)}
    except BROKEN as error:
        raise MotionError(f"not an array file that numpy reads without pickle: {error}", path) from error


def _members(path: Path) -> dict[str, Any]:
    arrays, pickles = {}, []
    with ZipFile(path) as archive:
        for info in archive.infolist():
            if info.file_size > LARGEST:
                raise MotionError(f"{info.filename} is larger than {LARGEST // 2**30} GB once it is unpacked", path)
            name = info.filename.removesuffix(".npy")
            with archive.open(info) as member:
                data = io.BytesIO(member.read())
            try:
                arrays[name] = np.lib.format.read_array(data, allow_pickle=False)
            except ValueError as error:
                if "Object arrays" not in str(error):
                    raise
                pickles.append(name)
    if pickles and not arrays:
        raise ValueError(f"{', '.join(pickles)} hold objects")
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
