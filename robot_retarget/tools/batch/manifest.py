"""The manifest: one row for each clip on each robot, a line of JSON each.

A row is appended after its outputs are on the disk, and a later row of a clip replaces the earlier one, so a run that is killed at any
moment can continue; the end of a run sorts the lines. Rows hold only values that are equal from run to run; times and memory are in
another file.
"""

import json
import os
import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import OutputError, UsageError
from robot_retarget.base.files import folder, made_folder, replacing, write_text
from robot_retarget.tools.batch.task import DONE, Row, TaskResult, sha256_of

INDEX, TIMES, HASHES = "index.jsonl", "times.jsonl", ".hashes.jsonl"
SCRATCH = re.compile(r"\..+-[a-z0-9_]{8}(\..*)?")
"""Temporary names of `files.replacing`."""
COLUMNS = tuple(field.name for field in fields(Row))


@contextmanager
def locked_folder(out: Path) -> Iterator[Path]:
    """The folder of results, locked for one run; temporary files of a killed run are removed.

    Raises:
        OutputError: it cannot be written, holds other things than results, or another run is at work in it.
    """
    if out.is_dir() and not (out / INDEX).exists() and any(not path.name.startswith(".") for path in out.iterdir()):
        raise OutputError(f"{out} holds files and no {INDEX}: it is not a batch folder; give another --out")
    with made_folder(out) as target:
        for scratch in target.rglob(".*"):
            if scratch.is_file() and SCRATCH.fullmatch(scratch.name):
                scratch.unlink()
        (target / INDEX).touch()
        yield target


class Manifest:
    """The manifest of a folder of results; lines that cannot be read are passed over, and their clips repeated."""

    def __init__(self, folder: Path):
        """Read it, if there is one."""
        self._folder = folder
        self._rows = {row.key: row for row in map(_row, _lines(folder / INDEX)) if row is not None}
        self._hashes = {facts[0]: facts[1:] for facts in _lines(folder / HASHES) if isinstance(facts, list) and facts}

    def rows(self) -> Iterator[Row]:
        """All rows, by robot and clip."""
        return (self._rows[key] for key in sorted(self._rows))

    def put(self, row: Row) -> None:
        """Write a row, in place of an earlier one of the same clip and robot."""
        self._rows[row.key] = row
        self._append(INDEX, _columns(row))

    def time(self, outcome: TaskResult) -> None:
        """Write how long a task took [s] and how much memory its process had [MB]."""
        names = ("robot", "clip", "seconds", "peak_mb")
        self._append(TIMES, {name: getattr(outcome, name) for name in names})

    def sha256(self, path: Path) -> str:
        """The sha256 of a file, hashed only where its size or time changed since; `unreadable` where it cannot be read."""
        try:
            now = [path.stat().st_size, path.stat().st_mtime_ns]
            known = self._hashes.get(str(path), [])
            if known[:2] != now:
                self._hashes[str(path)] = known = [*now, sha256_of(path)]
                if (self._folder / INDEX).exists():  # not for a folder that is only looked at
                    self._append(HASHES, [str(path), *known])
        except OSError:  # reading it fails later, with a sentence
            return "unreadable"
        return known[2]

    def save_index(self) -> Path:
        """Write the rows sorted, each once."""
        return write_text(self._folder / INDEX, "".join(_text(_columns(row)) for row in self.rows()))

    def _append(self, name: str, facts: Any) -> None:
        try:
            with (self._folder / name).open("a", encoding="utf-8") as file:
                file.write(_text(facts))
        except OSError as error:
            raise OutputError(f"cannot write {self._folder / name}: {error.strerror or error}") from error


def _columns(row: Row) -> dict[str, Any]:
    """Return the columns of a row, also of one with further fields."""
    return {name: getattr(row, name) for name in COLUMNS}


def _text(facts: Any) -> str:
    return json.dumps(facts, ensure_ascii=False, sort_keys=True) + "\n"


def _lines(path: Path) -> Iterator[Any]:
    """The values of the lines of a file; none without it, or of a line that was cut off."""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else ():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def _row(facts: Any) -> Row | None:
    try:
        return Row(**facts)
    except TypeError:
        return None


# Join the folders of several shards into one.


def merge(parts: Sequence[Path], out: Path) -> int:
    """Copy outputs and rows of the parts into `out`; files on one disk are linked. Returns the number of rows.

    A clip that is done in one part and failed in another is done. Running it again continues.

    Raises:
        UsageError: a part holds no manifest, or two parts made the same clip from other inputs or settings.
        OutputError: `out` cannot be written.
    """
    for part in parts:
        if not (part / INDEX).is_file():
            raise UsageError(f"{part} holds no {INDEX}")
    with locked_folder(out) as target:
        whole = Manifest(target)
        rows = {row.key: row for row in whole.rows()}
        for part in parts:
            for row in Manifest(part).rows():
                rows[row.key] = _better(rows.get(row.key), row, part)
            _copy(part, target)
        for row in rows.values():
            whole.put(row)
        whole.save_index()
        return len(rows)


def _better(known: Row | None, row: Row, part: Path) -> Row:
    if known is None or (known.state != DONE and row.state == DONE):
        return row
    if row.state == DONE and known.digest != row.digest:
        raise UsageError(f"{part}: {row.clip} on {row.robot} was made from another input or other settings than before")
    return known


def _copy(part: Path, target: Path) -> None:
    for path in sorted(part.rglob("*")):
        inner = path.relative_to(part)
        if path.is_dir() or path.name.startswith(".") or len(inner.parts) == 1:
            continue
        place = target / inner
        folder(place.parent)
        with replacing(place) as scratch:
            _link(path, scratch)


def _link(path: Path, scratch: Path) -> None:
    """Link a file to a temporary name, or copy it to another disk."""
    scratch.unlink()
    try:
        os.link(path, scratch)
    except OSError:
        shutil.copyfile(path, scratch)
