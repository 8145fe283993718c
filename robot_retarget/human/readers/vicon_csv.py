"""CSV of Vicon Nexus: the block `Trajectories` with the places of markers, or of joint centres.

Lines of the block: `Trajectories`, frames per second, labels (`Anna:LKNE`) over every third column, `Frame,Sub Frame,X,Y,Z,…`,
units, then rows; an empty cell is a lost point, and an empty line ends the block.
"""

import csv
from pathlib import Path

import numpy as np

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.markers.labelled import UNITS, LabelledPoints, captured, numbers, title_of
from robot_retarget.human.readers.request import Request

BLOCK = "trajectories"


def matches_format(header: FileHeader) -> bool:
    """Whether a text has the block, or one of the blocks that stand before it."""
    first = header.text.lstrip("\ufeff").partition(",")[0].strip().partition("\n")[0].strip().lower()
    return first == BLOCK or (first in ("devices", "joints", "model outputs") and header.path.suffix.lower() == ".csv")


def read(path: Path, request: Request) -> Capture:
    """Read the trajectories and put joints between them.

    Raises:
        MotionError: the block is missing, a row of another form, or labels from which no joints follow.
    """
    with path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
        rows = list(csv.reader(file))
    first = next((k for k, row in enumerate(rows) if row and row[0].strip().lower() == BLOCK), None)
    if first is None or len(rows) < first + 6:
        raise MotionError("no block of Trajectories with a row a frame: export trajectories, not only devices", path)
    rate, labels, units = rows[first + 1][0], rows[first + 2][2:], rows[first + 4][2:]
    titles = [title_of(label) for label in labels[::3] if label.strip()]
    unit = next((word.strip().lower() for word in units if word.strip()), "mm")
    if unit not in UNITS:
        raise MotionError(f"units: expected one of {', '.join(UNITS)}, found {unit!r}", path, first + 5)
    places = []
    for line, row in enumerate(rows[first + 5 :], first + 6):
        if not any(cell.strip() for cell in row):
            break
        places.append(numbers(row[2:], 3 * len(titles), path, line))
    points = np.array(places).reshape(len(places), len(titles), 3) * UNITS[unit]
    return captured(LabelledPoints(titles, points, float(rate)), path, request)
