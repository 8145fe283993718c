"""A figure: its name, unit, printed digits, and the function that measures it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

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


# Figures of reports: units that people read, and limits.

UNITS = {"rad": (57.29578, "°"), "m": (1000.0, "mm"), "of all": (100.0, "%")}
"""What figures are shown in: a factor and a unit for each unit of the report."""


def shown(value: float | str, unit: str) -> str:
    """Return a figure in a common unit: 0.2 rad as 11.5°. Texts are returned unchanged."""
    if isinstance(value, str):
        return value
    factor, name = UNITS.get(unit, (1.0, "°" if unit == "deg" else unit))
    return f"{factor * value + 0.0:.3g}{'' if name == '°' or not name else ' '}{name}"


def shown_apart(value: float, bound: float, unit: str) -> tuple[str, str]:
    """Return a figure and its limit in a common unit; where both texts are the same, the limit has the difference: `11.5° by 0.02°`."""
    texts = shown(value, unit), shown(bound, unit)
    same = value != bound and texts[0] == texts[1]
    return (texts[0], f"{texts[1]} by {shown(abs(value - bound), unit)}") if same else texts


NEAR_LIMIT = 0.1
"""By definition, a figure is near its limit within this share of the limit, on either side [-]."""


class Check(NamedTuple):
    """A threshold, the figure it bounds, its name and unit for people, and the sentence of a figure beyond it.

    Sentences may contain `{value}` and `{bound}` with their units, `{number}` without, and other figures.
    """

    threshold: str
    figure: str
    what: str
    unit: str
    sentence: str = "{what}: {value}, more than {bound}"

    def exceeded(self, figures: Mapping[str, Any], most: Any) -> bool:
        """Return whether the figure is beyond its threshold; one that does not apply is not."""
        return (figures.get(self.figure) or 0.0) > getattr(most, self.threshold)

    def near(self, figures: Mapping[str, Any], most: Any) -> bool:
        """Return whether the figure is within `NEAR_LIMIT` of its threshold."""
        value, bound = figures.get(self.figure), getattr(most, self.threshold)
        return value is not None and 0 < bound < np.inf and abs(value - bound) <= NEAR_LIMIT * bound

    def reason(self, figures: Mapping[str, Any], most: Any) -> str:
        """Return the sentence of a figure."""
        value, bound = figures[self.figure], getattr(most, self.threshold)
        number, texts = UNITS.get(self.unit, (1.0, ""))[0] * value, shown_apart(value, bound, self.unit)
        texts = {"what": self.what, "value": texts[0], "bound": texts[1]}
        return self.sentence.format(**{**figures, **texts, "number": number})
