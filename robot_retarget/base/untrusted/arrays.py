"""NumPy's files, `.npy` and `.npz`: plain numbers and text, each array of the size that its head states."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from robot_retarget.base.errors import FileError
from robot_retarget.base.untrusted.limits import BROKEN, LIMITS, is_zip, opened_member, opened_zip, refusing

PLAIN = "biufSU"
"""Letters of NumPy's kinds of numbers and text. Objects are pointers, and records may hold them."""


@dataclass(frozen=True)
class Head:
    """Shape and type of an array, as a file states them; a type that is not plain is never made."""

    shape: tuple[int, ...]
    dtype: np.dtype

    def __post_init__(self) -> None:
        if any(not isinstance(n, int) or n < 0 for n in self.shape):
            raise ValueError(f"an array of the shape {self.shape}")

    @property
    def plain(self) -> bool:
        """Whether it holds numbers or text alone."""
        return self.dtype.kind in PLAIN and self.dtype.itemsize > 0

    @property
    def size(self) -> int:
        """Of the numbers [bytes]."""
        return math.prod(self.shape) * self.dtype.itemsize

    def require(self, limit: int, there: int | None = None) -> None:
        """Require a plain array within a limit, of as many bytes as there are.

        A size of 0 counts as 1, for NumPy walks along the others.

        Raises:
            ValueError: it is not.
        """
        if not self.plain:
            raise ValueError(f"an array of {self.dtype}, which is not plain numbers or text")
        if there is not None and self.size != there:
            raise ValueError(f"it states {self.size} bytes {self.shape}, and holds {there}")
        if math.prod(max(n, 1) for n in self.shape) * self.dtype.itemsize > limit:
            raise ValueError(f"an array {self.shape} of {self.dtype} takes more than {limit} bytes")


@dataclass(frozen=True, eq=False)
class Archive(Mapping[str, np.ndarray]):
    """The plain arrays of an `.npz`. Each is read on first access; names and heads cost no unpacking."""

    path: Path
    heads: Mapping[str, Head]
    _read: dict[str, np.ndarray] = field(default_factory=dict)

    def __iter__(self) -> Iterator[str]:
        return iter(self.heads)

    def __len__(self) -> int:
        return len(self.heads)

    def __getitem__(self, name: str) -> np.ndarray:
        """Read an array.

        Raises:
            KeyError: the archive has no array of this name.
            FileError: its bytes are broken, or it is larger than its limit.
        """
        if name not in self._read:
            head = self.heads[name]
            with opened_zip(self.path, f".npz: {name}") as archive, opened_member(archive, f"{name}.npy") as member:
                head.require(LIMITS.unpacked(self.path))
                self._read[name] = np.lib.format.read_array(member, allow_pickle=False)
        return self._read[name]


def load_npz(path: Path) -> Archive:
    """Open an `.npz`; arrays of Python objects and records are absent.

    Raises:
        FileError: it cannot be read, is no `.npz`, or an array has another size than its head states.
    """
    heads: dict[str, Head] = {}
    with opened_zip(path, ".npz") as archive:
        for member in archive.infolist():
            if member.filename.endswith(".npy"):
                with opened_member(archive, member.filename) as stream:
                    head = read_head(stream)
                    if head.plain:
                        head.require(LIMITS.file, member.file_size - stream.tell())
                        heads[member.filename.removesuffix(".npy")] = head
    return Archive(path, heads)


def load_arrays(path: Path) -> Mapping[str, np.ndarray]:
    """Open an `.npz`, or read an `.npy`, whose array is called `positions`.

    Raises:
        FileError: as `load_npz`, or it holds no plain array.
    """
    arrays = load_npz(path) if is_zip(path) else {"positions": _load_npy(path)}
    if not arrays:
        raise FileError(f"{path}: holds no array that numpy reads without pickle")
    return arrays


def _load_npy(path: Path) -> np.ndarray:
    with refusing(path, "array file without pickle"), path.open("rb") as file:
        head = read_head(file)
        head.require(LIMITS.file, path.stat().st_size - file.tell())
        file.seek(0)
        return np.lib.format.read_array(file, allow_pickle=False)


def read_head(stream: IO[bytes]) -> Head:
    """Read the head of an `.npy`; the stream is left where the numbers begin.

    Raises:
        ValueError: the stream is no `.npy`.
    """
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return Head(shape, dtype)


def shape_of(path: Path) -> tuple[int, ...]:
    """Return the shape of an `.npy`, by its head; empty for any other file."""
    try:
        with path.open("rb") as file:
            return read_head(file).shape
    except BROKEN:
        return ()


def save_npz(path: Path, **arrays: Any) -> None:
    """Write an `.npz` under any name."""
    with path.open("wb") as stream:
        np.savez(stream, **arrays)
