"""ASF files, the skeletons of AMC motions: bones with a direction, a length and local axes.

At rest no bone is turned. A bone with axes C and angles M turns by L = C M C⁻¹ in its parent, and carries its children
at its end, d · ℓ away from its start.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError, known
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.pace import rate_from_gait
from robot_retarget.human.skeleton import Skeleton, forward

ANGLES = ("rx", "ry", "rz")
PLACES = ("tx", "ty", "tz")


@dataclass
class Bone:
    """A bone of the file, in its unit."""

    name: str
    line: int
    direction: tuple[float, ...] = (0.0, 0.0, 0.0)
    length: float = 0.0
    axis: Rotation | None = None
    """C; None where the file says none."""
    dof: tuple[str, ...] = ()
    """What moves it, in the order of the numbers of an AMC."""
    parent: str = ""


@dataclass(frozen=True)
class Asf:
    """A skeleton of bones, the root first and parents before children."""

    bones: tuple[Bone, ...]
    degrees: bool

    def skeleton(self) -> Skeleton:
        """A joint where each bone starts, called after it, and one where each last bone ends."""
        names = [bone.name for bone in self.bones]
        parents = [names.index(bone.parent) if bone.parent else -1 for bone in self.bones]
        reach = np.array([np.array(bone.direction) * bone.length for bone in self.bones])
        offsets = [reach[parent] if parent >= 0 else np.zeros(3) for parent in parents]
        ends = [k for k in range(1, len(names)) if k not in parents]
        return Skeleton(
            (*names, *(f"{names[k]}_end" for k in ends)),
            np.array([*parents, *ends]),
            np.array([*offsets, *(reach[k] for k in ends)]),
        )


def parse_asf(text: str, path: str | Path) -> Asf:
    """Read the text of an ASF file.

    Raises:
        MotionError: a section, bone or number is missing or wrong; names the line and the expected content.
    """
    sections: dict[str, list[_Line]] = {}
    section = ""
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].split()
        if words and words[0].startswith(":"):
            section = words[0].lower()
        elif words:
            sections.setdefault(section, []).append((number, words))
    angles = [words[-1].lower() for _, words in sections.get(":units", []) if words[0].lower() == "angle"]
    parser = _Parser(path, not angles or angles[-1].startswith("deg"))
    parser.root({words[0].lower(): (line, words[1:]) for line, words in sections.get(":root", [])})
    parser.bonedata(sections.get(":bonedata", []))
    parser.hierarchy(sections.get(":hierarchy", []))
    return parser.finished()


_Line = tuple[int, list[str]]
"""Its number, and its words."""


class _Parser:
    """Makes bones of the lines of each section."""

    def __init__(self, path: str | Path, degrees: bool):
        self.path, self.degrees = path, degrees
        self.bones: dict[str, Bone] = {"root": Bone("root", 1)}

    def root(self, fields: dict[str, _Line]) -> None:
        root = self.bones["root"]
        if "order" in fields:
            root.dof = self._dof(*fields["order"])
        if "axis" in fields or "orientation" in fields:
            line, words = fields.get("orientation", (1, ["0"] * 3))
            where, order = fields.get("axis", (line, ["XYZ"]))
            angles = self._numbers(words[:3], 3, "orientation", line)
            root.axis = self._axes(angles, order[0] if order else "", where)

    def bonedata(self, lines: list[_Line]) -> None:
        bone: Bone | None = None
        for line, (word, *words) in lines:
            match word.lower():
                case "begin":
                    bone = Bone("", line)
                case "end":
                    if bone is None or not bone.name:
                        raise self._error("a bone without a name: expected begin, name … , end", line)
                    if bone.name in self.bones:
                        raise self._error(f"a second bone {bone.name!r}", line)
                    self.bones[bone.name], bone = bone, None
                case other if bone is None:
                    raise self._error(f"{other!r} outside begin … end of a bone", line)
                case "name":
                    bone.name = words[0] if words else ""
                case "direction":
                    bone.direction = tuple(self._numbers(words, 3, "direction", line))
                case "length":
                    bone.length = self._numbers(words, 1, "length", line)[0]
                case "axis":
                    bone.axis = self._axes(self._numbers(words[:3], 3, "axis", line), words[-1], line)
                case "dof":
                    bone.dof = self._dof(line, words)

    def hierarchy(self, lines: list[_Line]) -> None:
        for line, words in lines:
            for name in words if words[0].lower() not in ("begin", "end") else ():
                if name not in self.bones:
                    raise self._error(f"unknown bone {name!r}; {known(self.bones)}", line)
                if name != words[0]:
                    self.bones[name].parent = words[0]

    def _dof(self, line: int, words: list[str]) -> tuple[str, ...]:
        dof = tuple(word.lower() for word in words)
        strange = [word for word in dof if word not in (*ANGLES, *PLACES, "l")]
        if strange:
            raise self._error(f"unknown degree of freedom {strange[0]!r}; {known((*PLACES, *ANGLES, 'l'))}", line)
        return dof

    def _axes(self, angles: list[float], order: str, line: int) -> Rotation:
        if sorted(order.upper()) != ["X", "Y", "Z"]:
            raise self._error(f"expected an order of axes such as XYZ, found {order!r}", line)
        return Rotation.from_euler(order.lower(), angles, degrees=self.degrees)

    def _numbers(self, words: list[str], count: int, what: str, line: int) -> list[float]:
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        if len(numbers) != count or not np.isfinite(numbers).all():
            raise self._error(f"{what}: expected {count} finite numbers, found {' '.join(words) or 'nothing'}", line)
        return numbers

    def _error(self, message: str, line: int) -> MotionError:
        return MotionError(message, self.path, line)

    def finished(self) -> Asf:
        root = self.bones["root"]
        if len(self.bones) == 1:
            raise MotionError("expected :bonedata with bones, found none", self.path)
        if not root.dof:
            raise MotionError("expected :root with an order such as TX TY TZ RX RY RZ", self.path)
        loose = [bone for bone in self.bones.values() if bone is not root and not bone.parent]
        if loose:
            raise self._error(f"bone {loose[0].name!r} has no parent in :hierarchy", loose[0].line)
        ordered = tuple(self._below("root"))
        if len(ordered) != len(self.bones):
            lost = next(name for name in self.bones if name not in {bone.name for bone in ordered})
            raise self._error(f"bone {lost!r} does not hang from the root", self.bones[lost].line)
        return Asf(ordered, self.degrees)

    def _below(self, name: str) -> Iterator[Bone]:
        yield self.bones[name]
        for child in [bone.name for bone in self.bones.values() if bone.parent == name and bone.name != "root"]:
            yield from self._below(child)


# AMC files: the angles of the bones of an ASF skeleton, frame by frame (the format of the CMU library).

CMU_FPS = 120.0
"""Rate of the CMU library, for a motion without a gait; an AMC file has no rate [1/s]."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as AMC does."""
    return any(line.strip().upper() == ":FULLY-SPECIFIED" for line in header.text.splitlines())


def read(path: Path, request: Request) -> Capture:
    """Read an AMC file and the ASF file next to it.

    Raises:
        MotionError: the folder has no skeleton, or one of both files is broken; names the line and the expected content.
    """
    asf_file = skeleton_beside(path)
    asf = parse_asf(asf_file.read_text(encoding="utf-8", errors="replace"), asf_file)
    values = _frames(path.read_text(encoding="utf-8", errors="replace"), path, asf)
    skeleton = asf.skeleton()
    translations = np.tile(skeleton.offsets, (len(values["root"]), 1, 1))
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (*translations.shape[:2], 1))
    for joint, bone in enumerate(asf.bones):
        translations[:, joint] += _moved(bone, values[bone.name])
        turns[:, joint] = _turned(bone, values[bone.name], asf.degrees)
    positions, rotations = forward(skeleton.parents, translations, turns)
    fps, notes = request.rate(usual=CMU_FPS)
    capture = Capture(skeleton, positions, rotations, fps, str(path), (f"The skeleton is that of {asf_file.name}.",))
    walked = rate_from_gait(capture) if request.fps is None else None
    fps, notes = (walked[0], (walked[1],)) if walked else (fps, notes)
    return replace(capture, fps=fps, notes=(*capture.notes, *notes))


def beside(path: Path) -> tuple[Path, ...]:
    """Return the ASF of an AMC; None without one."""
    try:
        return (skeleton_beside(path),)
    except MotionError:
        return ()


def skeleton_beside(path: Path) -> Path:
    """The ASF of an AMC: called as the file, or as its subject (`02.asf` of `02_01.amc`), or the only one in the folder.

    Raises:
        MotionError: the folder has no ASF, or several.
    """
    folder = sorted(one for one in path.parent.iterdir() if one.suffix.lower() == ".asf")
    subject = path.stem.partition("_")[0]
    for stem in (path.stem, subject):
        called = [one for one in folder if one.stem.lower() == stem.lower()]
        if called:
            return called[0]
    if len(folder) == 1:
        return folder[0]
    found = f"; there are {', '.join(one.name for one in folder)}" if folder else ""
    raise MotionError(f"needs its skeleton next to it, {subject}.asf or {path.stem}.asf{found}", path)


def _frames(text: str, path: Path, asf: Asf) -> dict[str, Floats]:
    """The numbers (T, D) of every bone, in the order of its degrees of freedom."""
    wanted = {bone.name: bone.dof for bone in asf.bones if bone.dof}
    rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
    frames, line = 0, 0
    for line, content in enumerate(text.splitlines(), 1):
        words = content.split()
        if not words or words[0][0] in "#:":
            continue
        if len(words) == 1 and words[0].isdecimal():
            _check_whole(rows, frames, path, line)
            frames += 1
        else:
            _take(words, rows, wanted, frames, path, line)
    if not frames:
        raise MotionError("expected frames, a number and then a line a bone; found none", path, max(line, 1))
    _check_whole(rows, frames, path, line)
    return {bone.name: np.array(rows.get(bone.name, [[]] * frames), dtype=float) for bone in asf.bones}


def _take(
    words: list[str],
    rows: dict[str, list[list[float]]],
    wanted: dict[str, tuple[str, ...]],
    frames: int,
    path: Path,
    line: int,
) -> None:
    """One line of a frame: a bone and its numbers."""
    name, dof = words[0], wanted.get(words[0])
    if dof is None:
        raise MotionError(f"the skeleton has no bone {name!r} that moves", path, line)
    if len(rows[name]) >= frames:
        raise MotionError(f"a second line for {name!r} in one frame; expected the next frame's number", path, line)
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if len(numbers) != len(dof) or not np.isfinite(numbers).all():
        raise MotionError(
            f"{name!r}: expected {len(dof)} finite numbers ({' '.join(dof)}), found {words[1:]}", path, line
        )
    rows[name].append(numbers)


def _check_whole(rows: dict[str, list[list[float]]], frames: int, path: Path, line: int) -> None:
    missing = [name for name, numbers in rows.items() if len(numbers) < frames]
    if missing:
        raise MotionError(f"frame {frames} ends without {missing[0]!r}: truncated, or of another skeleton", path, line)


def _moved(bone: Bone, values: Floats) -> Floats:
    """(T, 3) how far a bone is from where its parent ends; a change of length is not followed."""
    place = np.zeros((len(values), 3))
    for column, freedom in enumerate(bone.dof):
        if freedom in PLACES:
            place[:, PLACES.index(freedom)] = values[:, column]
    return place


def _turned(bone: Bone, values: Floats, degrees: bool) -> Floats:
    """(T, 4) L = C M C⁻¹ of a bone, w x y z; the angles of M turn about fixed axes, in the order of the freedoms."""
    columns = [column for column, freedom in enumerate(bone.dof) if freedom in ANGLES]
    turn = Rotation.identity(len(values))
    for column in columns:
        turn = Rotation.from_euler(bone.dof[column][1], values[:, column, None], degrees=degrees) * turn
    if bone.axis is not None:
        turn = bone.axis * turn * bone.axis.inv()
    return turn.as_quat(scalar_first=True)
