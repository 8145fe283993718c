"""Tables of text with markers, joint centres or bones: TRC, and the CSV exports of Vicon Nexus and OptiTrack Motive."""

import csv
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError, known
from robot_retarget.base.untrusted.rotations import checked_quaternions
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers.points import (
    LabelledPoints,
    bridged,
    bridged_turns,
    labelled_capture,
    metres_in,
    numbers,
    title_of,
)
from robot_retarget.human.readers.positions import first_offsets
from robot_retarget.human.skeleton import Skeleton

# TRC: a table of markers or of joint centres, as OpenSim, Pose2Sim, OpenCap and Cortex write it.
#
# Lines: `PathFileType`, names of the header's values, the values, labels over every third column, `X1 Y1 Z1 …`, then rows
# of frame, time and places; columns are separated by tabs, and an empty cell is a lost point.


def is_trc(header: FileHeader) -> bool:
    """Whether a text begins as TRC does."""
    return header.text.lstrip().lower().startswith("pathfiletype")


def read_trc(path: Path, request: Request) -> Capture:
    """Read the points and put joints between them.

    Raises:
        MotionError: a line of another form, an unknown unit, or labels from which no joints follow.
    """
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    if len(lines) < 6:
        raise MotionError(f"expected five lines of header and a row a frame, found {len(lines)} lines", path)
    keys, values, labels = lines[1].split(), lines[2].split(), lines[3].split("\t")
    header = {key.strip().lower(): value.strip() for key, value in zip(keys, values, strict=False)}
    metres = metres_in(header.get("units", "mm"), "Units", path, 3)
    titles = [title_of(label) for label in labels[2:] if label.strip()]
    rows = [(k, line) for k, line in enumerate(lines[5:], 6) if line.strip()]
    count = 3 * len(titles)
    points = np.array([numbers(_cells(line, 2 + count)[2:], count, path, k) for k, line in rows])
    points = points.reshape(len(rows), -1, 3)
    rate = header.get("datarate") or header.get("camerarate")
    return labelled_capture(LabelledPoints(titles, points * metres, float(rate) if rate else None), path, request)


# CSV of Vicon Nexus: the block `Trajectories` with the places of markers, or of joint centres.
#
# Lines of the block: `Trajectories`, frames per second, labels (`Anna:LKNE`) over every third column, `Frame,Sub Frame,X,Y,Z,…`,
# units, then rows; an empty cell is a lost point, and an empty line ends the block.

BLOCK = "trajectories"


def _cells(line: str, count: int) -> list[str]:
    """The cells of a row; where tabs are doubled, and no cell is empty, the tabs between them count once."""
    cells = line.rstrip().split("\t")
    filled = [cell for cell in cells if cell.strip()]
    return filled if len(cells) > count == len(filled) else cells


def is_vicon(header: FileHeader) -> bool:
    """Whether a text has the block, or one of the blocks that stand before it."""
    first = header.text.lstrip("\ufeff").partition(",")[0].strip().partition("\n")[0].strip().lower()
    return first == BLOCK or (first in ("devices", "joints", "model outputs") and header.path.suffix.lower() == ".csv")


def read_vicon(path: Path, request: Request) -> Capture:
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
    metres = metres_in(next((word.strip() for word in units if word.strip()), "mm"), "units", path, first + 5)
    places = []
    for line, row in enumerate(rows[first + 5 :], first + 6):
        if not any(cell.strip() for cell in row):
            break
        places.append(numbers(row[2:], 3 * len(titles), path, line))
    points = np.array(places).reshape(len(places), len(titles), 3) * metres
    return labelled_capture(LabelledPoints(titles, points, float(rate)), path, request)


# CSV of OptiTrack Motive: bones of skeletons in the world, or markers.
#
# Line 1 holds pairs of name and value (`Export Frame Rate`, `Length Units`). Five rows then name the columns by type (`Bone`,
# `Marker`, …), name (`Anna:LShin`), ID, quantity (`Rotation`, `Position`) and axis; the first of them begins with `,Type`.

MOTIVE_UNITS = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
"""Metres in each unit of the format."""
# Each bone of Motive's skeletons and the bone that carries it, in its own names and in those of FBX exports.
_SIDED = {
    "Shoulder": "Chest", "UArm": "{}Shoulder", "FArm": "{}UArm", "Hand": "{}FArm",
    "Thigh": "Hip", "Shin": "{}Thigh", "Foot": "{}Shin", "Toe": "{}Foot",
}  # fmt: skip
PARENTS = {"Hip": "", "Ab": "Hip", "Spine2": "Ab", "Chest": "Ab", "Neck": "Chest", "Head": "Neck"} | {
    f"{side}{bone}": parent.format(side) for side in "LR" for bone, parent in _SIDED.items()
}
_MARKERS = ("marker", "bone marker", "labeled marker")


class _Table:
    """The columns of a file by type, name and quantity."""

    def __init__(self, path: Path):
        with path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
            rows = list(csv.reader(file))
        start = next((k for k, row in enumerate(rows[:16]) if len(row) > 1 and row[1].strip().lower() == "type"), None)
        axes = next((k for k, row in enumerate(rows[:16]) if row and row[0].strip().lower() == "frame"), None)
        if start is None or axes is None:
            raise MotionError("no rows of Type, Name and axes: export with the header of Motive", path)
        pairs = [cell.strip().lower() for cell in rows[0]]
        self.header = dict(zip(pairs[::2], pairs[1::2], strict=False))
        self.types, self.names = ([cell.strip() for cell in row] for row in (rows[start], rows[start + 1]))
        self.quantities, self.axes = ([cell.strip().lower() for cell in rows[k]] for k in (axes - 1, axes))
        self.values = np.array(
            [numbers(row, len(self.axes), path, k) for k, row in enumerate(rows[axes + 1 :], axes + 2)]
        )
        if not len(self.values):
            raise MotionError("no frames after the header", path, axes + 1)

    def of(self, types: tuple[str, ...], quantity: str, axes: str) -> dict[str, Floats]:
        """Per name the columns (T, A) of a quantity, NaN where lost."""
        found: dict[str, list[int]] = {}
        for k, (kind, name) in enumerate(zip(self.types, self.names, strict=False)):
            if kind.lower() in types and self.quantities[k] == quantity and self.axes[k] in axes:
                found.setdefault(name, []).append(k)
        whole = {name: sorted(at, key=lambda k: axes.index(self.axes[k])) for name, at in found.items()}
        return {name: self.values[:, at] for name, at in whole.items() if len(at) == len(axes)}


def is_motive(header: FileHeader) -> bool:
    """Whether a text begins as Motive's exports do."""
    return header.text.lstrip().lower().startswith("format version,")


def read_motive(path: Path, request: Request) -> Capture:
    """Read the bones of the first skeleton or of the requested one; without bones, the markers.

    Raises:
        MotionError: neither, another unit, local coordinates, Euler angles, or bones that are not a body's.
    """
    table = _Table(path)
    rate = table.header.get("export frame rate") or table.header.get("capture frame rate")
    unit = table.header.get("length units", "meters")
    if unit not in MOTIVE_UNITS or table.header.get("coordinate space", "global") != "global":
        found = f"{unit}, {table.header.get('coordinate space', 'global')}"
        raise MotionError(f"expected {', '.join(MOTIVE_UNITS)} in global coordinates, found {found}", path, 1)
    fps = float(rate) if rate else None
    places = table.of(("bone",), "position", "xyz")
    if places:
        return _bones(places, table.of(("bone",), "rotation", "wxyz"), MOTIVE_UNITS[unit], fps, path, request)
    markers = table.of(_MARKERS, "position", "xyz")
    if not markers:
        raise MotionError("holds neither bones nor markers with positions", path)
    points = np.stack(list(markers.values()), axis=1) * MOTIVE_UNITS[unit]
    return labelled_capture(LabelledPoints([title_of(name) for name in markers], points, fps), path, request)


def _bones(
    places: dict[str, Floats], turns: dict[str, Floats], unit: float, fps: float | None, path: Path, request: Request
) -> Capture:
    people = sorted({name.rpartition(":")[0] for name in places})
    which, others = request.choose(people, path)
    title = f"{people[which]}:" if people[which] else ""
    bones = [bone for bone in PARENTS if title + bone in places and title + bone in turns]
    if not {"Hip", "LShin", "RShin", "LFArm", "RFArm"} <= set(bones):
        raise MotionError(f"its bones are not those of Motive's skeletons: {known(places)}", path)
    rate, notes = request.rate(fps)
    values = np.stack([np.concatenate([places[title + b], turns[title + b]], axis=1) for b in bones], axis=1)
    kept, span, gaps = bridged(values[..., :3], bones, rate, str(path))
    stored = checked_quaternions(values[span][..., 3:], "Rotation", gaps=True)
    rotations, lost = bridged_turns(stored, bones, rate, str(path), span.start)
    parents = np.array([bones.index(p) if (p := _present(PARENTS[b], bones)) else -1 for b in bones])
    skeleton = Skeleton(tuple(bones), parents, first_offsets(parents, kept * unit, rotations))
    return Capture(skeleton, kept * unit, rotations, rate, str(path), (*others, *gaps, *lost, *notes))


def _present(parent: str, bones: list[str]) -> str:
    """The nearest bone above that the file has; empty at the root."""
    while parent and parent not in bones:
        parent = PARENTS[parent]
    return parent
