"""Rigid bodies of a CSV export of OptiTrack Motive: y up, quaternions x y z w, empty cells where a body was not seen."""

import csv
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import SceneError, known

COLUMNS = (("Position", "XYZ"), ("Rotation", "WXYZ"))
"""Channels of a pose and their axes, in the order x y z, w x y z."""
KIND = "Rigid Body"
"""The heading of columns of rigid bodies; those of their markers are `Rigid Body Marker`."""


def read(path: Path, name: str) -> tuple[Floats, float | None, str | None]:
    """Read one rigid body.

    Args:
        path: the CSV.
        name: of the rigid body.

    Returns:
        Poses (T, 7) x y z, w x y z in the file's unit, NaN where the body was not seen; frames per second; the unit.

    Raises:
        SceneError: the file is no export of Motive, rotations are not quaternions, no rigid body has the name, or a cell is no number.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.reader(file))
    start = next((k for k, row in enumerate(rows) if row and row[0].strip() == "Frame"), None)
    if start is None or start < 3:
        raise SceneError(f"{path}: no CSV export of Motive; expected a row that begins with 'Frame' under the headings")
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    if facts.get("Rotation Type", "Quaternion") != "Quaternion":
        raise SceneError(f"{path}:1: rotations are {facts['Rotation Type']}; export them from Motive as quaternions")
    columns = _columns(path, rows[:start], rows[start], name)
    table = [_numbers(path, k, row, columns) for k, row in enumerate(rows[start + 1 :], start + 2) if row]
    rate = facts.get("Export Frame Rate", facts.get("Capture Frame Rate"))
    return np.array(table).reshape(-1, 7), float(rate) if rate else None, facts.get("Length Units")


def _columns(path: Path, headings: list[list[str]], axes: list[str], name: str) -> list[int]:
    """Return the columns of a rigid body, in the order of `COLUMNS`."""
    kinds = next((row for row in headings if KIND in row), [])
    names, channels = headings[headings.index(kinds) + 1] if kinds else [], headings[-1]
    rigid = {k: names[k] for k, kind in enumerate(kinds) if kind == KIND and k < len(names)}
    found = {(channels[k], axes[k]): k for k, title in rigid.items() if title == name and k < len(channels)}
    wanted = [(channel, axis) for channel, letters in COLUMNS for axis in letters]
    if not all(key in found for key in wanted):
        raise SceneError(f"{path}: no rigid body {name!r}; {known(dict.fromkeys(rigid.values()), typed=name)}")
    return [found[key] for key in wanted]


def _numbers(path: Path, line: int, row: list[str], columns: list[int]) -> list[float]:
    """Return the numbers of some columns, NaN where a cell is empty or absent."""
    cells = [row[k] if k < len(row) else "" for k in columns]
    try:
        return [float(cell) if cell.strip() else np.nan for cell in cells]
    except ValueError as error:
        raise SceneError(f"{path}:{line}: {error}") from error
