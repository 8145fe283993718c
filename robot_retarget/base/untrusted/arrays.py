"""NumPy's files, `.npy` and `.npz`, read as plain numbers and text of the size that their heads state, and checked as fields."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError, RobotRetargetError, known
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


KINDS = {"number": "fiu", "integer": "iu", "text": "U"}
"""Kinds of fields, and the letters of their NumPy data types."""
RATE_KEYS = ("fps", "motion_fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate", "frequency")
"""Names of frames per second."""
RATES = (0.01, 10_000.0)
"""Frame rates outside these bounds are mistakes [1/s]."""
FARTHEST = 10_000.0
"""A position farther from the origin is a mistake [m]: the longest recorded walks outdoors are shorter."""


@dataclass(frozen=True)
class Field:
    """The kind, shape and bounds of one array of a file."""

    kind: Literal["number", "integer", "text"]
    shape: tuple[int | str, ...] = ()
    """Sizes; a letter names a size that all fields of the file share. () also accepts one value in an array."""
    bounds: tuple[float, float] | None = None
    """Of every number; without them numbers are not checked."""
    required: bool = True


def read_fields(path: str | Path, fields: Mapping[str, Field], error: type[RobotRetargetError]) -> dict[str, Any]:
    """Read the fields of an `.npz` file; other arrays of the file are not read.

    Raises:
        error: The file cannot be read, lacks a required field, or a field is not as stated.
    """
    try:
        arrays = load_npz(Path(path))
        return _checked(path, arrays, fields)
    except FileError as problem:
        raise error(str(problem)) from problem


def _checked(path: str | Path, arrays: Mapping[str, Any], fields: Mapping[str, Field]) -> dict[str, Any]:
    missing = [name for name, field in fields.items() if field.required and name not in arrays]
    if missing:
        raise FileError(f"{path}: no key {missing[0]!r}; {known(arrays)}")
    sizes: dict[str, int] = {}
    found = {}
    for name, wanted in fields.items():
        if name in arrays:
            found[name] = _fitted(f"{path}: {name}", arrays[name], wanted, sizes)
            _require_bounds(f"{path}: {name}", found[name], wanted)
    return found


def _fitted(name: str, array: Any, field: Field, sizes: dict[str, int]) -> Any:
    """The array of a field, of its kind and shape; binds the letters of the shape in `sizes`."""
    if array.dtype.kind not in KINDS[field.kind]:
        raise FileError(f"{name} must be of kind {field.kind}, got an array of {array.dtype}")
    if not field.shape and array.size == 1:
        return array.reshape(())
    if len(field.shape) == array.ndim:
        for size, actual in zip(field.shape, array.shape, strict=True):
            if isinstance(size, str):
                sizes.setdefault(size, actual)
    wanted = tuple(sizes.get(size, size) if isinstance(size, str) else size for size in field.shape)
    if array.shape != wanted:
        raise FileError(f"{name} must be {_shape(wanted)}, got {array.shape}")
    return array


def _shape(sizes: tuple[int | str, ...]) -> str:
    """A shape as NumPy prints it, with letters for free sizes."""
    return f"({', '.join(map(str, sizes))}{',' if len(sizes) == 1 else ''})"


def _require_bounds(name: str, array: Any, field: Field) -> None:
    if field.bounds is None:
        return
    low, high = field.bounds
    wrong = np.argwhere(~((array >= low) & (array <= high)))
    if len(wrong):
        place = tuple(int(k) for k in wrong[0])
        where = f" at {list(place)}" if place else ""
        raise FileError(f"{name} must be in {low:g} … {high:g}, got {array[place]:g}{where}")


def shaped(values: Any, shape: tuple[int | None, ...], what: str) -> Floats:
    """Return an array as numbers of the given shape.

    Args:
        shape: None means any length above zero.
        what: the array's name, for the message.

    Raises:
        FileError: the shape differs, the array is empty, or it does not hold numbers.
    """
    array = np.asarray(values)
    wanted = ", ".join("any" if size is None else str(size) for size in shape)
    if array.dtype.kind not in KINDS["number"] or array.ndim != len(shape):
        raise FileError(f"{what} must be numbers of shape ({wanted}), got {array.dtype} {array.shape}")
    if any(size is not None and size != found for size, found in zip(shape, array.shape, strict=True)):
        raise FileError(f"{what} must have the shape ({wanted}), got {array.shape}")
    if not array.size:
        raise FileError(f"{what} is empty: {array.shape}")
    return array.astype(np.float64)


def rate_of(table: Mapping[str, Any]) -> float | None:
    """Return frames per second under any of `RATE_KEYS`; None where no key states them.

    Raises:
        FileError: they are not one positive number.
    """
    key = next((key for key in RATE_KEYS if key in table), None)
    if key is None:
        return None
    value = np.asarray(table[key])
    if value.size != 1 or value.dtype.kind not in KINDS["number"] or not RATES[0] <= value.item() <= RATES[1]:
        found = (
            f"{value.item():g}"
            if value.size == 1 and value.dtype.kind in KINDS["number"]
            else f"{value.dtype} {value.shape}"
        )
        raise FileError(f"{key} must be one positive number from {RATES[0]:g} to {RATES[1]:g}, got {found}")
    return float(value.item())
