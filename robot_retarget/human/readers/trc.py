"""TRC: a table of markers or of joint centres, as OpenSim, Pose2Sim, OpenCap and Cortex write it.

Lines: `PathFileType`, names of the header's values, the values, labels over every third column, `X1 Y1 Z1 …`, then rows
of frame, time and places; columns are separated by tabs, and an empty cell is a lost point.
"""

from pathlib import Path

import numpy as np

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.markers.labelled import UNITS, LabelledPoints, captured, numbers, title_of
from robot_retarget.human.readers.request import Request


def matches_format(header: FileHeader) -> bool:
    """Whether a text begins as TRC does."""
    return header.text.lstrip().lower().startswith("pathfiletype")


def read(path: Path, request: Request) -> Capture:
    """Read the points and put joints between them.

    Raises:
        MotionError: a line of another form, an unknown unit, or labels from which no joints follow.
    """
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    if len(lines) < 6:
        raise MotionError(f"expected five lines of header and a row a frame, found {len(lines)} lines", path)
    keys, values, labels = (lines[k].split("\t") for k in (1, 2, 3))
    header = {key.strip().lower(): value.strip() for key, value in zip(keys, values, strict=False)}
    unit = header.get("units", "mm").lower()
    if unit not in UNITS:
        raise MotionError(f"Units: expected one of {', '.join(UNITS)}, found {unit!r}", path, 3)
    titles = [title_of(label) for label in labels[2:] if label.strip()]
    rows = [(k, line) for k, line in enumerate(lines[5:], 6) if line.strip()]
    points = np.array([numbers(line.split("\t")[2:], 3 * len(titles), path, k) for k, line in rows]).reshape(
        len(rows), -1, 3
    )
    rate = header.get("datarate") or header.get("camerarate")
    return captured(LabelledPoints(titles, points * UNITS[unit], float(rate) if rate else None), path, request)
