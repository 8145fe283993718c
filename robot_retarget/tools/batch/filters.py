"""Named sets of thresholds that choose clips, with a reason for each that is left out."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from robot_retarget.base.errors import UsageError, known
from robot_retarget.base.untrusted.documents import read_toml
from robot_retarget.scores.score import FIGURES
from robot_retarget.tools.batch.task import DONE, Row

SHIPPED = Path(__file__).with_name("filters.toml")


@dataclass(frozen=True)
class Bound:
    """A figure and the values that are let through."""

    figure: str
    least: float
    most: float

    def reason(self, row: Row) -> str | None:
        """Why a row is rejected; None if it passes or the figure does not apply."""
        value = row.figures.get(self.figure)
        if value is None or self.least <= value <= self.most:
            return None
        unit, cause = FIGURES[self.figure].unit, FIGURES[self.figure].cause
        side, bound = ("below", self.least) if value < self.least else ("above", self.most)
        sentence = f"{self.figure} {value:g} {unit} is {side} {bound:g}".replace("  ", " ")
        return f"{sentence} ({cause})" if cause else sentence


@dataclass(frozen=True)
class Filter:
    """A named set of thresholds."""

    name: str
    bounds: tuple[Bound, ...]

    def reasons(self, row: Row) -> tuple[str, ...]:
        """Why a row is left out; none where it passes."""
        if row.state != DONE:
            return (f"{row.state}: {row.message}",)
        return tuple(reason for bound in self.bounds if (reason := bound.reason(row)))


@dataclass(frozen=True)
class Chosen:
    """The rows that a filter lets through, and the others with their reasons."""

    filter: Filter
    passed: tuple[Row, ...]
    rejected: tuple[tuple[Row, tuple[str, ...]], ...]


def choose(rows: Iterable[Row], filter: Filter) -> Chosen:
    """Apply a filter."""
    judged = [(row, filter.reasons(row)) for row in rows]
    passed = tuple(row for row, reasons in judged if not reasons)
    return Chosen(filter, passed, tuple((row, reasons) for row, reasons in judged if reasons))


def read_filters(path: Path = SHIPPED) -> dict[str, Filter]:
    """The filters of a TOML file: a table each, `figure = [least, most]`, `figure = most`, or `include = ["other"]`.

    Raises:
        UsageError: it cannot be read, or names a figure or a filter that does not exist.
    """
    tables = read_toml(path, UsageError)
    return {name: Filter(name, tuple(_bounds(path, name, tables, ()))) for name in tables}


def _bounds(path: Path, name: str, tables: Mapping[str, object], within: tuple[str, ...]) -> list[Bound]:
    table = tables.get(name)
    if not isinstance(table, dict):
        raise UsageError(f"{path}: no filter [{name}]; {known(tables, typed=name)}")
    if name in within:
        raise UsageError(f"{path}: the filter {name!r} includes itself")
    found = list[Bound]()
    for key, value in table.items():
        if key == "include":
            for other in value if isinstance(value, list) else [value]:
                found += _bounds(path, str(other), tables, (*within, name))
        else:
            found.append(_bound(path, name, key, value))
    return found


def _bound(path: Path, name: str, figure: str, value: object) -> Bound:
    if figure not in FIGURES:
        raise UsageError(f"{path}: [{name}] names the figure {figure!r}; {known(FIGURES, 60, typed=figure)}")
    pair = value if isinstance(value, list) else [float("-inf"), value]
    if len(pair) != 2 or not all(isinstance(end, int | float) and not isinstance(end, bool) for end in pair):
        raise UsageError(f"{path}: [{name}] {figure} must be a number or [least, most], got {value!r}")
    return Bound(figure, float(pair[0]), float(pair[1]))
