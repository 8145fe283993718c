"""A figure: its name, unit, printed digits, and the function that measures it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.scores.subject import Subject

Value = float | np.floating[Any] | None
"""None where a figure does not apply: no human motion, no feet, no contact to keep."""


@dataclass(frozen=True)
class Figure:
    """One number of a score."""

    name: str
    unit: str
    digits: int
    """Decimals that are printed; 0 makes it an integer."""
    what: str
    """One line for tables."""
    better: str = "lower"
    """`lower`, `higher` or `neither`."""
    most: float | None = None
    """Upper end of its range; None if unbounded. The lower end is 0 unless `what` says otherwise."""
    cause: str = ""
    """The usual content of a clip that a filter rejects by it."""

    def rounded(self, value: Value) -> Value:
        """The value rounded to its digits."""
        if value is None:
            return None
        return round(float(value), self.digits) + 0.0 if self.digits else int(value)  # −0.0 + 0.0 is 0.0


@dataclass(frozen=True)
class Measure:
    """Figures and the function that measures them together."""

    figures: tuple[Figure, ...]
    of: Callable[[Subject], tuple[Value, ...]]
    human: bool = False
    """Whether it compares with a human motion."""
    feet: bool = False
    """Whether it needs recognised feet."""
    scene: bool = False
    """Whether it needs bodies around the robot."""

    def values(self, subject: Subject) -> dict[str, Value]:
        """The figures by name; all None without the motion or feet that they need."""
        lacking = (self.human and subject.compared is None) or (self.feet and not subject.soles)
        lacking |= self.scene and subject.trajectory.scene is None
        found = (None,) * len(self.figures) if lacking else self.of(subject)
        return {figure.name: figure.rounded(value) for figure, value in zip(self.figures, found, strict=True)}


def measures(
    *figures: Figure, human: bool = False, feet: bool = False, scene: bool = False
) -> Callable[[Callable[[Subject], tuple[Value, ...]]], Measure]:
    """Return the decorator that makes a `Measure` of the function which returns the values of some figures."""
    return lambda of: Measure(figures, of, human, feet, scene)
