"""Bounded readers of files from other programs: archives of arrays and compressed files."""

import gzip
import io
import math
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.errors import TrajectoryError, install_line

LARGEST = 2 << 30
"""Largest unpacked size of a file [bytes]: two hours of a humanoid of 30 bodies with all velocities at 50 frames per second."""
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
    """The file's bytes, decompressed from lz4, gzip or zlib.

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


@dataclass(frozen=True)
class Head:
    """Shape and type of an array, as the first bytes of its `.npy` state them."""

    shape: tuple[int, ...]
    dtype: np.dtype


@dataclass(frozen=True, eq=False)
class Archive(Mapping[str, np.ndarray]):
    """The plain arrays of an `.npz`. Each is read on first access; names and heads cost no unpacking."""

    path: Path
    heads: Mapping[str, Head]
    """Arrays of Python objects are absent: they are pickles."""
    _read: dict[str, np.ndarray] = field(default_factory=dict)

    def __iter__(self) -> Iterator[str]:
        return iter(self.heads)

    def __len__(self) -> int:
        return len(self.heads)

    def __getitem__(self, name: str) -> np.ndarray:
        """Read an array.

        Raises:
            KeyError: the archive has no array of this name.
            TrajectoryError: its bytes are broken.
        """
        if name not in self._read:
            self.heads[name]
            with _opened(self.path) as archive, archive.open(f"{name}.npy") as member:
                self._read[name] = np.lib.format.read_array(member, allow_pickle=False)
        return self._read[name]


def load_npz(path: Path) -> Archive:
    """Open an `.npz`.

    Raises:
        TrajectoryError: it cannot be read, is no `.npz`, unpacks to more than `LARGEST`, or an array has another size
            than its head states.
    """
    with _opened(path) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > LARGEST:
            raise _too_large(path)
        names = [member for member in members if member.filename.endswith(".npy")]
        heads = {member.filename.removesuffix(".npy"): _head(archive, member) for member in names}
    return Archive(path, {name: head for name, head in heads.items() if not head.dtype.hasobject})


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except OSError as error:
        raise TrajectoryError(f"cannot read {path}: {error.strerror or error}") from error
    except BROKEN as error:
        raise TrajectoryError(f"{path}: not a readable .npz: {error}") from error


def _head(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Head:
    """The head of an array whose bytes are as many as it states.

    Raises:
        ValueError: they are not.
    """
    with archive.open(member) as stream:
        head = read_head(stream)
        there = member.file_size - stream.tell()
    stated = math.prod(head.shape) * head.dtype.itemsize
    if (stated != there or min(head.shape, default=0) < 0) and not head.dtype.hasobject:
        raise ValueError(f"{member.filename} states {stated} bytes {head.shape}, and holds {there}")
    return head


def read_head(stream: IO[bytes]) -> Head:
    """Read the head of an `.npy`; the stream is left where the numbers begin.

    Raises:
        ValueError: the stream is no `.npy`.
    """
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return Head(shape, dtype)


def shaped(values: Any, shape: tuple[int | None, ...], what: str) -> Floats:
    """An array as numbers of the given shape.

    Args:
        shape: None means any length above zero.
        what: the array's name, for the message.

    Raises:
        TrajectoryError: the shape differs, the array is empty, or it does not hold numbers.
    """
    array = np.asarray(values)
    wanted = ", ".join("any" if size is None else str(size) for size in shape)
    if array.dtype.kind not in "fiu" or array.ndim != len(shape):
        raise TrajectoryError(f"{what} must be numbers of shape ({wanted}), got {array.dtype} {array.shape}")
    if any(size is not None and size != found for size, found in zip(shape, array.shape, strict=True)):
        raise TrajectoryError(f"{what} must have the shape ({wanted}), got {array.shape}")
    if not array.size:
        raise TrajectoryError(f"{what} is empty: {array.shape}")
    return array.astype(np.float64)


def save_npz(path: Path, **arrays: Any) -> None:
    """Write an `.npz` under any name."""
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
