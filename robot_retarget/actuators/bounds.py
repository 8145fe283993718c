"""Numbers that are checked where they come in: each field of a dataclass states the range outside which it is a mistake."""

from collections.abc import Mapping
from dataclasses import fields
from numbers import Real
from typing import Any, NamedTuple

from robot_retarget.base.errors import ServoError


class MapError(ServoError):
    """A value of a servo map that cannot be; `key` is its place in the file, from the top."""

    def __init__(self, message: str, *key: str) -> None:
        super().__init__(message)
        self.key = key


class Bounds(NamedTuple):
    """From the lowest to the highest value that is no mistake."""

    low: float
    high: float
    unit: str = ""

    def require(self, what: str, value: Any, *key: str) -> None:
        """Check one value.

        Raises:
            MapError: it is no number, not finite, or outside.
        """
        if not isinstance(value, Real) or isinstance(value, bool):
            raise MapError(f"{what} cannot be {value!r}, it is a number", *key)
        if not self.low <= float(value) <= self.high:
            unit = f" {self.unit}" if self.unit else ""
            raise MapError(f"{what} {value:g} is not in {self.low:g}…{self.high:g}{unit}", *key)


def within(low: float, high: float, unit: str = "") -> Mapping[str, Bounds]:
    """The metadata of a dataclass' field that is to keep within bounds; `require_bounds` sees to it."""
    return {"bounds": Bounds(low, high, unit)}


def require_bounds(thing: Any, prefix: str = "") -> None:
    """Check every bounded field of a dataclass.

    Raises:
        MapError: one is no number, not finite, or outside its bounds.
    """
    for f in fields(thing):
        bounds: Bounds | None = f.metadata.get("bounds")
        if bounds is not None:
            bounds.require(prefix + f.name, getattr(thing, f.name), f.name)
