"""Bytes of files that others made: never more of them than a machine can hold."""

import gzip
import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.errors import TrajectoryError, install_line

LARGEST = 2 << 30
"""What a file may hold unpacked [bytes]: two hours of a humanoid of 30 bodies with all velocities at 50 frames per second."""
CHUNK = 1 << 20
BROKEN = (
    ValueError,
    EOFError,
    MemoryError,
    NotImplementedError,
    OverflowError,
    RuntimeError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What Python's readers raise at bytes that are no archive, or no array."""
LZ4_MAGIC, GZIP_MAGIC, ZLIB_MAGIC = b"\x04\x22\x4d\x18", b"\x1f\x8b", b"\x78"


def file_bytes(path: Path) -> bytes:
    """The file, whole.

    Raises:
        TrajectoryError: it cannot be read or is too large.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise TrajectoryError(f"{path}: {path.stat().st_size} bytes, more than {LARGEST}")
        return path.read_bytes()
    except OSError as error:
        raise TrajectoryError(f"cannot read {path}: {error.strerror or error}") from error


def unpacked(path: Path) -> bytes:
    """The file's bytes, decompressed where it is lz4, gzip or zlib.

    Raises:
        TrajectoryError: it cannot be read, is broken, or unpacks to more than `LARGEST`.
    """
    data = file_bytes(path)
    try:
        if data.startswith(LZ4_MAGIC):
            return _bounded(_lz4().frame.open(io.BytesIO(data)), path)
        if data.startswith(GZIP_MAGIC):
            return _bounded(gzip.open(io.BytesIO(data)), path)
        if data.startswith(ZLIB_MAGIC) and data[1:2] in b"\x01\x5e\x9c\xda":
            packed = zlib.decompressobj()
            plain = packed.decompress(data, LARGEST)
            if packed.unconsumed_tail:
                raise _too_large(path)
            return plain
    except (OSError, EOFError, RuntimeError, zlib.error) as error:
        raise TrajectoryError(f"{path}: broken compressed file: {error}") from error
    return data


def lz4_packed(data: bytes) -> bytes:
    """Bytes as an lz4 frame (extra `formats`)."""
    return _lz4().frame.compress(data)


def load_npz(path: Path, names: Container[str] | None = None) -> dict[str, np.ndarray]:
    """Read the plain arrays of an `.npz`; arrays of Python objects are left out, for they are pickles.

    Args:
        names: The arrays to read; by default all.

    Raises:
        TrajectoryError: The file cannot be read, is not an `.npz`, or unpacks to more than `LARGEST`.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist() if m.filename.endswith(".npy")}
            wanted = {name: m for name, m in members.items() if names is None or name in names}
            if sum(member.file_size for member in wanted.values()) > LARGEST:
                raise _too_large(path)
            read = {name: _array(archive.read(member)) for name, member in wanted.items()}
    except OSError as error:
        raise TrajectoryError(f"cannot read {path}: {error.strerror or error}") from error
    except BROKEN as error:
        raise TrajectoryError(f"{path}: not a readable .npz: {error}") from error
    return {name: array for name, array in read.items() if array is not None}


def _array(data: bytes) -> np.ndarray | None:
    """An array of plain numbers or text; None for an array of objects.

    The size in the header is compared with the data before memory is allocated for it.
    """
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.hasobject:
        return None
    size, present = math.prod(shape) * dtype.itemsize, len(data) - stream.tell()
    if size != present or min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {shape} and type {dtype} takes {size} bytes, and {present} are there")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def save_npz(path: Path, **arrays: Any) -> None:
    """Write an `.npz`, whatever the end of its name."""
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


def _bounded(stream: Any, path: Path) -> bytes:
    parts, total = [], 0
    with stream:
        while part := stream.read(CHUNK):
            parts.append(part)
            total += len(part)
            if total > LARGEST:
                raise _too_large(path)
    return b"".join(parts)


def _too_large(path: Path) -> TrajectoryError:
    return TrajectoryError(f"{path}: unpacks to more than {LARGEST} bytes; a motion is not that large")


def _lz4() -> Any:
    try:
        import lz4.frame
    except ImportError:
        raise TrajectoryError(f"lz4 files need lz4: {install_line('formats')}") from None
    return lz4
