"""ASF files, the skeletons of AMC motions: bones with a direction, a length and local axes.

At rest no bone is turned. A bone with axes C and angles M turns by L = C M C⁻¹ in its parent, and carries its children
at its end, d · ℓ away from its start.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import MotionError, known
from robot_retarget.human.skeleton import Skeleton

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
    parser = _Parser(path)
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].split()
        if words:
            parser.take(words, number)
    return parser.finished()


class _Parser:
    """Takes the lines one by one; a section lasts until the next word with a colon."""

    def __init__(self, path: str | Path):
        self.path, self.section, self.degrees = path, "", True
        self.bones: dict[str, Bone] = {"root": Bone("root", 1)}
        self.bone: Bone | None = None
        self.axis_order = "XYZ"
        self.orientation = [0.0, 0.0, 0.0]

    def take(self, words: list[str], line: int) -> None:
        if words[0].startswith(":"):
            self.section = words[0].lower()
        elif self.section in (":units", ":root", ":bonedata", ":hierarchy"):
            getattr(self, "_" + self.section[1:])(words, line)

    def _units(self, words: list[str], line: int) -> None:
        if words[0].lower() == "angle":
            self.degrees = words[-1].lower().startswith("deg")

    def _root(self, words: list[str], line: int) -> None:
        match words[0].lower():
            case "order":
                self.bones["root"].dof = self._dof(words[1:], line)
            case "axis":
                self.axis_order = words[1] if len(words) > 1 else ""
            case "orientation":
                self.orientation = self._numbers(words[1:4], 3, "orientation", line)
            case _:
                return
        self.bones["root"].axis = self._axes(self.orientation, self.axis_order, line)

    def _bonedata(self, words: list[str], line: int) -> None:
        match words[0].lower():
            case "begin":
                self.bone = Bone("", line)
            case "end":
                self._keep(line)
            case other if self.bone is None:
                raise self._error(f"{other!r} outside begin … end of a bone", line)
            case "name":
                self.bone.name = words[1] if len(words) > 1 else ""
            case "direction":
                self.bone.direction = tuple(self._numbers(words[1:], 3, "direction", line))
            case "length":
                self.bone.length = self._numbers(words[1:], 1, "length", line)[0]
            case "axis":
                self.bone.axis = self._axes(self._numbers(words[1:4], 3, "axis", line), words[-1], line)
            case "dof":
                self.bone.dof = self._dof(words[1:], line)

    def _keep(self, line: int) -> None:
        bone, self.bone = self.bone, None
        if bone is None or not bone.name:
            raise self._error("a bone without a name: expected begin, name … , end", line)
        if bone.name in self.bones:
            raise self._error(f"a second bone {bone.name!r}", line)
        self.bones[bone.name] = bone

    def _hierarchy(self, words: list[str], line: int) -> None:
        if words[0].lower() in ("begin", "end"):
            return
        for name in words:
            if name not in self.bones:
                raise self._error(f"unknown bone {name!r}; {known(self.bones)}", line)
        for name in words[1:]:
            self.bones[name].parent = words[0]

    def _dof(self, words: list[str], line: int) -> tuple[str, ...]:
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
