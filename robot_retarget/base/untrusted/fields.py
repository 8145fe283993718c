"""Arrays of a file, checked on reading: each field states its kind, shape and bounds."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import FileError, RobotRetargetError, known
from robot_retarget.base.untrusted.arrays import load_npz

KINDS = {"number": "fiu", "integer": "iu", "text": "U"}
"""Kinds of fields, and the letters of their NumPy data types."""
RATE_KEYS = ("fps", "motion_fps", "framerate", "frame_rate", "mocap_framerate", "mocap_frame_rate", "frequency")
"""Names of frames per second."""


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
    for name, field in fields.items():
        if name in arrays:
            found[name] = _fitted(f"{path}: {name}", arrays[name], field, sizes)
            _require_bounds(f"{path}: {name}", found[name], field)
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
    if value.size != 1 or value.dtype.kind not in KINDS["number"] or not 0 < value.item() < np.inf:
        raise FileError(f"{key} must be one positive number, got {value.dtype} {value.shape}")
    return float(value.item())
