"""The HIERARCHY of a BVH file: joints, their offsets and their channels, as exporters really write them."""

import re
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import LISTED, MotionError, known
from robot_retarget.human.skeleton import Skeleton

CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")
_BY_SPELLING = {channel.lower(): channel for channel in CHANNELS}
_WORD = re.compile(r"[{}]|[^\s{}]+")
_STATEMENTS = "ROOT, JOINT, End Site, OFFSET, CHANNELS, { or }"


@dataclass(frozen=True)
class Hierarchy:
    """The tree of joints in file units, and for each joint the channels that move it, in the order of the rows."""

    skeleton: Skeleton
    channels: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...]

    @property
    def width(self) -> int:
        """Numbers in a row of MOTION."""
        return sum(map(len, self.channels))


def parse_hierarchy(text: str, path: str | Path, first_line: int = 1) -> Hierarchy:
    """Read the text between HIERARCHY and MOTION.

    Raises:
        MotionError: a brace, number or channel is missing or unknown; names the line and the expected content.
    """
    words = [
        (match.group(), line)
        for line, content in enumerate(text.split("\n"), first_line)
        for match in _WORD.finditer(content)
    ]
    builder = _Builder(_Words(words, path))
    builder.build()
    return builder.hierarchy()


class _Words:
    """The words of the text with their lines, read once from left to right."""

    def __init__(self, words: list[tuple[str, int]], path: str | Path):
        self.words, self.path, self.at = words, path, 0

    @property
    def line(self) -> int:
        return self.words[min(self.at, len(self.words) - 1)][1] if self.words else 1

    def peek(self) -> str | None:
        return self.words[self.at][0] if self.at < len(self.words) else None

    def take(self) -> str:
        self.at += 1
        return self.words[self.at - 1][0]

    def rest_of_line(self) -> str:
        """The words up to the line's end or a brace: names may hold spaces."""
        line, taken = self.words[self.at - 1][1], []
        while (word := self.peek()) is not None and word not in "{}" and self.line == line:
            taken.append(self.take())
        return " ".join(taken)

    def numbers(self) -> list[float]:
        """As many numbers as follow."""
        taken: list[float] = []
        while (word := self.peek()) is not None and word not in "{}":
            try:
                taken.append(float(word.replace(",", ".")))
            except ValueError:
                break
            self.at += 1
        return taken

    def error(self, message: str, line: int | None = None) -> MotionError:
        return MotionError(message, self.path, self.line if line is None else line)


@dataclass
class _Node:
    name: str
    parent: int
    line: int
    site: bool
    offset: list[float] | None = None
    channels: tuple[str, ...] = ()


@dataclass
class _Builder:
    words: _Words
    nodes: list[_Node] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    stack: list[int] = field(default_factory=list)
    long_offsets: list[str] = field(default_factory=list)
    """Joints whose OFFSET has more than three numbers."""
    pending: bool = False
    """A joint was named and its opening brace is still to come."""

    def build(self) -> None:
        while self.words.peek() is not None:
            line, word = self.words.line, self.words.take()
            match word.lower():
                case "{":
                    self._open(line)
                case "}":
                    self._close(line)
                case "root" | "joint":
                    self._node(self.words.rest_of_line(), line, site=False)
                case "offset":
                    self._offset(line)
                case "channels":
                    self._channels(line)
                case other if other == "end" or other.startswith("endsite"):
                    self.words.rest_of_line()
                    self._node("", line, site=True)
                case _:
                    raise self.words.error(f"expected {_STATEMENTS}, found {word!r}", line)
        if self.stack or self.pending:
            name = self.nodes[self.stack[-1] if self.stack else -1].name
            raise self.words.error(f"the hierarchy ends inside joint {name!r}: expected '}}'")
        if not self.nodes:
            raise self.words.error("the hierarchy has no joint: expected ROOT name")

    def _node(self, name: str, line: int, site: bool) -> None:
        if self.pending:
            raise self.words.error(f"expected '{{' after joint {self.nodes[-1].name!r}", line)
        if site and not self.stack:
            raise self.words.error("an End Site outside every joint", line)
        self.nodes.append(_Node(name, self.stack[-1] if self.stack else -1, line, site))
        self.pending = True

    def _open(self, line: int) -> None:
        if not self.pending:
            raise self.words.error("'{' without a joint before it: expected ROOT, JOINT or End Site", line)
        self.stack.append(len(self.nodes) - 1)
        self.pending = False

    def _close(self, line: int) -> None:
        if not self.stack or self.pending:
            raise self.words.error("'}' without its '{'", line)
        self.stack.pop()

    def _current(self, statement: str, line: int) -> _Node:
        if not self.stack or self.pending:
            raise self.words.error(f"{statement} outside the braces of a joint", line)
        return self.nodes[self.stack[-1]]

    def _offset(self, line: int) -> None:
        node, numbers = self._current("OFFSET", line), self.words.numbers()
        if len(numbers) < 3 or not np.isfinite(numbers).all():
            raise self.words.error(f"OFFSET of joint {node.name!r}: expected 3 finite numbers, found {numbers}", line)
        if len(numbers) > 3:
            self.long_offsets.append(f"{node.name!r} ({len(numbers)})")
        node.offset = numbers[:3]

    def _channels(self, line: int) -> None:
        node, count = self._current("CHANNELS", line), self.words.peek() or ""
        if not count.isdecimal():
            raise self.words.error(f"CHANNELS of joint {node.name!r}: expected their count, found {count!r}", line)
        self.words.take()
        names = self.words.rest_of_line().split()
        while len(names) < int(count) and (self.words.peek() or "").lower() in _BY_SPELLING:
            names.append(self.words.take())
        unknown = [name for name in names if name.lower() not in _BY_SPELLING]
        if unknown:
            raise self.words.error(f"unknown channel {unknown[0]!r} of joint {node.name!r}; {known(CHANNELS)}", line)
        if len(names) != int(count):
            raise self.words.error(f"CHANNELS {count} of joint {node.name!r} lists {len(names)} channels", line)
        node.channels = tuple(_BY_SPELLING[name.lower()] for name in names)

    def _note(self, joints: list[str], what: str) -> None:
        """One note for all joints of a kind."""
        if joints:
            listed = ", ".join(joints[:LISTED]) + (", …" if len(joints) > LISTED else "")
            self.notes.append(f"{len(joints)} joint{'s' if len(joints) > 1 else ''} {what}: {listed}.")

    def hierarchy(self) -> Hierarchy:
        self._note(self.long_offsets, "with more than 3 numbers of OFFSET use the first 3")
        for node in self.nodes:
            if node.offset is None:
                raise self.words.error(f"joint {node.name!r} has no OFFSET", node.line)
        skeleton = Skeleton(self._names(), np.array([n.parent for n in self.nodes]), self._offsets())
        return Hierarchy(skeleton, tuple(n.channels for n in self.nodes), tuple(self.notes))

    def _offsets(self) -> Floats:
        return np.array([node.offset for node in self.nodes], dtype=float)

    def _names(self) -> tuple[str, ...]:
        """Every joint's name, made unique; an end site is called after its parent."""
        inner = {node.parent for node in self.nodes}
        names: list[str] = []
        renamed: list[str] = []
        unnamed: list[str] = []
        for index, node in enumerate(self.nodes):
            # Some exporters spell an end site `JOINT Site`.
            spelled = node.name.lower() == "site" and not node.channels and index not in inner and node.parent >= 0
            wanted = f"{names[node.parent]}_end" if node.site or spelled else node.name
            if not wanted:
                wanted = f"joint_{index}"
                unnamed.append(f"{wanted!r} in line {node.line}")
            name, copy = wanted, 2
            while name in names:
                name, copy = f"{wanted}_{copy}", copy + 1
            if name != wanted and not (node.site or spelled):
                renamed.append(f"{name!r} in line {node.line}")
            names.append(name)
        self._note(unnamed, "without a name got one")
        self._note(renamed, "with the name of an earlier one got a number")
        return tuple(names)


# The MOTION of a BVH file: one row of numbers per frame, read at array speed, errors with their line.

_FRAMES = re.compile(r"(?im)^[ \t]*frames[ \t]*:?[ \t]*(\S*)")
_FRAME_TIME = re.compile(r"(?im)^[ \t]*frame[ \t]*time[ \t]*:?[ \t]*(\S*)")
_GLUED = re.compile(r"(?<=[\d.])(?=[-+])")
_NOT_A_NUMBER = re.compile(r"[-+]?(?:\d\.#\w+|nan\(\w*\))", re.IGNORECASE)
MISSING_ROWS = 0.01
"""Share of the announced frames that may be missing at the end (two always may); with more a file is refused as
truncated."""


@dataclass(frozen=True)
class Rows:
    """The channel values (T, C) of every frame, the line of each frame's row, and the time between frames [s]."""

    values: Floats
    lines: tuple[int, ...]
    frame_time: float
    notes: tuple[str, ...]


def parse_rows(text: str, path: str | Path, first_line: int, width: int) -> Rows:
    """Read the text after the word MOTION.

    Args:
        text: from the word MOTION on.
        path: of the file, for messages.
        first_line: line of the file in which `text` starts.
        width: numbers in a row, the channels of the hierarchy.

    Raises:
        MotionError: no frames, no or a wrong frame time, a row of another width, text among the numbers, a truncated
            file. Names the line.
    """
    announced, frame_time, start = _header(text, path, first_line)
    first = first_line + text.count("\n", 0, start)
    lines, notes = text[start:].split("\n"), []
    try:
        values, counts = _values(lines)
    except ValueError:
        lines = [_mended(line) for line in lines]
        _check_words(lines, path, first)
        values, counts = _values(lines)
        notes.append("Numbers written together or with a decimal comma were taken apart.")
    table, starts = _table(values, counts, path, first, width)
    if (note := _count_note(announced, len(table), path, starts[-1])) is not None:
        notes.append(note)
    return Rows(table, starts, frame_time, tuple(notes))


def _header(text: str, path: str | Path, first_line: int) -> tuple[int | None, float, int]:
    """Announced frames, frame time and where the numbers start."""
    frames, seconds = _FRAMES.search(text), _FRAME_TIME.search(text)
    if seconds is None:
        raise MotionError("expected 'Frame Time: seconds' after MOTION, found none", path, first_line)
    line = first_line + text.count("\n", 0, seconds.start())
    try:
        frame_time = float(seconds.group(1).replace(",", "."))
    except ValueError:
        raise MotionError(f"Frame Time must be a number of seconds, found {seconds.group(1)!r}", path, line) from None
    if not (np.isfinite(frame_time) and frame_time > 0):
        raise MotionError(f"Frame Time must be positive, found {seconds.group(1)}", path, line)
    start = max(seconds.end(), frames.end() if frames else 0)
    announced = int(frames.group(1)) if frames and frames.group(1).isdecimal() else None
    return announced, frame_time, start


def _values(lines: list[str]) -> tuple[Floats, Ints]:
    """Every number of the lines, and how many each line has. The words are never all in memory."""
    counts: list[int] = []

    def words(line: str) -> list[str]:
        found = line.split()
        counts.append(len(found))
        return found

    return np.fromiter(map(float, chain.from_iterable(map(words, lines))), dtype=float), np.array(counts)


def _mended(line: str) -> str:
    """A line without decimal commas, numbers glued at a sign, and other spellings of not-a-number."""
    text = line.replace(",", " " if "." in line else ".")
    return _GLUED.sub(" ", _NOT_A_NUMBER.sub("nan", text))


def _check_words(lines: list[str], path: str | Path, first: int) -> None:
    for number, line in enumerate(lines, first):
        for word in line.split():
            try:
                float(word)
            except ValueError:
                raise MotionError(f"expected a number, found {word[:40]!r}", path, number) from None


def _table(values: Floats, counts: Ints, path: str | Path, first: int, width: int) -> tuple[Floats, tuple[int, ...]]:
    """The numbers as (T, width) and the line each row starts in. Each line is a row, or all rows are wrapped."""
    filled = np.flatnonzero(counts)
    if not filled.size:
        raise MotionError("no frame follows Frame Time; expected a row of numbers", path, first)
    counts, lines = counts[filled], filled + first
    wrapped = width > 0 and np.all(counts < width) and len(values) % width == 0
    if not wrapped and not np.all(counts == width):
        bad = int(np.argmax(counts != width))
        cut = "MOTION is truncated: " if bad == len(counts) - 1 and counts[bad] < width else ""
        raise MotionError(f"{cut}a row of {counts[bad]} numbers, the hierarchy has {width} channels", path, lines[bad])
    before = np.cumsum(counts) - counts
    starts = np.searchsorted(before, np.arange(0, len(values), width), side="right") - 1
    return values.reshape(-1, width), tuple(lines[starts].tolist())


def _count_note(announced: int | None, found: int, path: str | Path, line: int) -> str | None:
    if announced is None:
        return f"The file does not say how many frames it has; {found} were found."
    if announced - found > max(2, MISSING_ROWS * announced):
        raise MotionError(f"MOTION is truncated: Frames says {announced}, {found} rows follow", path, line)
    return None if announced == found else f"Frames says {announced}, {found} rows follow; the rows are used."
