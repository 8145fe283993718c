"""CSV of OptiTrack Motive: bones of skeletons in the world, or markers.

Line 1 holds pairs of name and value (`Export Frame Rate`, `Length Units`). Five rows then name the columns by type (`Bone`,
`Marker`, …), name (`Anna:LShin`), ID, quantity (`Rotation`, `Position`) and axis; the first of them begins with `,Type`.
"""

import csv
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError, known
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.markers.labelled import LabelledPoints, captured, numbers, title_of
from robot_retarget.human.readers.points import bridged
from robot_retarget.human.readers.positions import first_offsets
from robot_retarget.human.readers.request import Request
from robot_retarget.human.skeleton import Skeleton

UNITS = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
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


def matches_format(header: FileHeader) -> bool:
    """Whether a text begins as Motive's exports do."""
    return header.text.lstrip().lower().startswith("format version,")


def read(path: Path, request: Request) -> Capture:
    """Read the bones of the first skeleton or of the requested one; without bones, the markers.

    Raises:
        MotionError: neither, another unit, local coordinates, Euler angles, or bones that are not a body's.
    """
    table = _Table(path)
    rate = table.header.get("export frame rate") or table.header.get("capture frame rate")
    unit = table.header.get("length units", "meters")
    if unit not in UNITS or table.header.get("coordinate space", "global") != "global":
        found = f"{unit}, {table.header.get('coordinate space', 'global')}"
        raise MotionError(f"expected {', '.join(UNITS)} in global coordinates, found {found}", path, 1)
    fps = float(rate) if rate else None
    places = table.of(("bone",), "position", "xyz")
    if places:
        return _bones(places, table.of(("bone",), "rotation", "wxyz"), UNITS[unit], fps, path, request)
    markers = table.of(_MARKERS, "position", "xyz")
    if not markers:
        raise MotionError("holds neither bones nor markers with positions", path)
    points = np.stack(list(markers.values()), axis=1) * UNITS[unit]
    return captured(LabelledPoints([title_of(name) for name in markers], points, fps), path, request)


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
    rotations = _held(values[span][..., 3:])
    parents = np.array([bones.index(p) if (p := _present(PARENTS[b], bones)) else -1 for b in bones])
    skeleton = Skeleton(tuple(bones), parents, first_offsets(parents, kept * unit, rotations))
    return Capture(skeleton, kept * unit, rotations, rate, str(path), (*others, *gaps, *notes))


def _held(turns: Floats) -> Floats:
    """(T, B, 4) without gaps: a lost bone keeps its last rotation."""
    seen = np.isfinite(turns).all(axis=2)
    last = np.maximum.accumulate(np.where(seen, np.arange(len(turns))[:, None], 0), axis=0)
    return turns[last, np.arange(turns.shape[1])]


def _present(parent: str, bones: list[str]) -> str:
    """The nearest bone above that the file has; empty at the root."""
    while parent and parent not in bones:
        parent = PARENTS[parent]
    return parent
