"""The MOTION of a BVH file: one row of numbers per frame, read at array speed, errors with their line."""

import re
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import MotionError

_FRAMES = re.compile(r"(?im)^[ \t]*frames[ \t]*:?[ \t]*(\S*)")
_FRAME_TIME = re.compile(r"(?im)^[ \t]*frame[ \t]*time[ \t]*:?[ \t]*(\S*)")
_GLUED = re.compile(r"(?<=[\d.])(?=[-+])")
_NOT_A_NUMBER = re.compile(r"[-+]?(?:\d\.#\w+|nan\(\w*\))", re.IGNORECASE)
MISSING_ROWS = 0.01
"""Share of the announced frames that may be missing at the end (two always may); more is a truncated file."""


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
