"""The manifest: one row for each clip on each robot, in SQLite with a write-ahead log.

A row is committed after its outputs are on the disk, so a run that is killed at any moment can continue. Rows hold only values that
are equal from run to run; times and memory are in another table.
"""

import fcntl
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from robot_retarget.base.errors import OutputError, UsageError
from robot_retarget.base.files import folder, replacing, write_text
from robot_retarget.tools.batch.task import DONE, Row, TaskResult

NAME, INDEX = "manifest.sqlite", "index.jsonl"
LOCK = ".lock"
SCRATCH = re.compile(r"\..+-[a-z0-9_]{8}(\..*)?")
"""Temporary names of `files.replacing`."""
COLUMNS = tuple(field.name for field in fields(Row))
_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS results ({", ".join(COLUMNS)}, PRIMARY KEY (robot, clip));
CREATE TABLE IF NOT EXISTS timings (robot, clip, seconds, peak_mb, PRIMARY KEY (robot, clip));
CREATE TABLE IF NOT EXISTS files (path PRIMARY KEY, size, changed, sha256);
"""


@contextmanager
def locked_folder(out: Path) -> Iterator[Path]:
    """The folder of results, locked for one run; temporary files of a killed run are removed.

    Raises:
        OutputError: it cannot be written, holds other things than results, or another run is at work in it.
    """
    strange = out.is_dir() and not (out / NAME).exists() and any(path.name != LOCK for path in out.iterdir())
    if strange:
        raise OutputError(f"{out} holds files and no {NAME}: it is not a batch folder; give another --out")
    target = folder(out)
    with (target / LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise OutputError(f"another run is at work in {out}") from error
        for scratch in target.rglob(".*"):
            if scratch.is_file() and SCRATCH.fullmatch(scratch.name):
                scratch.unlink()
        yield target


class Manifest:
    """The manifest of a folder of results."""

    path: Path
    notes: list[str]

    def __init__(self, folder: Path):
        """Open or create it. A broken manifest is moved aside and restored from the index; `notes` report that.

        Raises:
            OutputError: it cannot be written.
        """
        self.path, self.notes = folder / NAME, list[str]()
        try:
            self._base = self._opened()
        except sqlite3.DatabaseError as broken:
            self._move_aside(str(broken))
            self._base = self._opened()
            self._restore(folder / INDEX)

    def __enter__(self) -> "Manifest":
        return self

    def __exit__(self, *_: object) -> None:
        self._base.close()

    def rows(self) -> Iterator[Row]:
        """All rows, by robot and clip."""
        names = ", ".join(COLUMNS)
        for values in self._base.execute(f"SELECT {names} FROM results ORDER BY robot, clip"):
            facts = dict(zip(COLUMNS, values, strict=True))
            facts["figures"], facts["signature"] = json.loads(facts["figures"]), tuple(json.loads(facts["signature"]))
            yield Row(**facts)

    def put(self, row: Row) -> None:
        """Write a row, in place of an earlier one of the same clip and robot."""
        values = [getattr(row, name) for name in COLUMNS]
        values[COLUMNS.index("figures")] = json.dumps(row.figures, sort_keys=True)
        values[COLUMNS.index("signature")] = json.dumps(row.signature)
        self._write(f"INSERT OR REPLACE INTO results VALUES ({', '.join('?' * len(COLUMNS))})", values)

    def time(self, outcome: TaskResult) -> None:
        """Write how long a task took and how much memory its process had."""
        values = (outcome.robot, outcome.clip, outcome.seconds, outcome.peak_mb)
        self._write("INSERT OR REPLACE INTO timings VALUES (?, ?, ?, ?)", values)

    def timings(self) -> dict[tuple[str, str], tuple[float, float]]:
        """Seconds and peak memory [MB] by robot and clip."""
        return {
            (r, c): (s, m) for r, c, s, m in self._base.execute("SELECT robot, clip, seconds, peak_mb FROM timings")
        }

    def known_sha256(self, path: Path) -> str | None:
        """The sha256 of a file that was hashed before and has the same size and time since."""
        found = self._base.execute("SELECT size, changed, sha256 FROM files WHERE path = ?", (str(path),)).fetchone()
        now = path.stat()
        return found[2] if found and found[:2] == (now.st_size, now.st_mtime_ns) else None

    def note_sha256(self, path: Path, sha256: str) -> None:
        """Remember the sha256 of a file."""
        now = path.stat()
        self._write(
            "INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?)", (str(path), now.st_size, now.st_mtime_ns, sha256)
        )

    def save_index(self) -> Path:
        """Write the rows as JSON lines next to the manifest."""
        target = self.path.with_name(INDEX)
        return write_text(target, "".join(f"{_line(row)}\n" for row in self.rows()))

    def _write(self, statement: str, values: Iterable[Any]) -> None:
        try:
            with self._base:
                self._base.execute(statement, tuple(values))
        except sqlite3.Error as error:
            raise OutputError(f"cannot write {self.path}: {error}") from error

    def _opened(self) -> sqlite3.Connection:
        try:
            base = sqlite3.connect(self.path)
        except sqlite3.OperationalError as error:
            raise OutputError(f"cannot write {self.path}: {error}") from error
        try:
            base.execute("PRAGMA journal_mode = WAL")
            base.execute("PRAGMA synchronous = NORMAL")
            base.executescript(_SCHEMA)
            if base.execute("PRAGMA quick_check").fetchone() != ("ok",):
                raise sqlite3.DatabaseError("its pages are damaged")
            base.execute(f"SELECT {', '.join(COLUMNS)} FROM results LIMIT 1")
        except sqlite3.OperationalError as error:
            base.close()
            if "column" in str(error):
                raise sqlite3.DatabaseError(str(error)) from error
            raise OutputError(f"cannot write {self.path}: {error}") from error
        except sqlite3.DatabaseError:
            base.close()
            raise
        return base

    def _move_aside(self, reason: str) -> None:
        number = 1
        while (aside := self.path.with_name(f"{NAME}.broken-{number}")).exists():
            number += 1
        self.path.replace(aside)
        for ending in ("-wal", "-shm"):
            self.path.with_name(f"{NAME}{ending}").unlink(missing_ok=True)
        self.notes.append(f"{self.path} was broken ({reason}) and is now {aside.name}")

    def _restore(self, index: Path) -> None:
        """Take over the rows of the index that can be read."""
        count = 0
        for row in read_index(index) if index.is_file() else ():
            self.put(row)
            count += 1
        self.notes.append(f"{count} rows were taken from {INDEX}; other clips are repeated")


def _line(row: Row) -> str:
    """Return a line of the index."""
    return json.dumps({name: getattr(row, name) for name in COLUMNS}, ensure_ascii=False, sort_keys=True)


def read_index(path: Path) -> Iterator[Row]:
    """The rows of an index; lines that cannot be read are left out."""
    with closing(path.open(encoding="utf-8")) as lines:
        for line in lines:
            try:
                facts = json.loads(line)
                yield Row(**facts | {"signature": tuple(facts["signature"])})
            except (ValueError, TypeError, KeyError):
                continue


# Join the folders of several shards into one.

OWN = (NAME, INDEX, LOCK)


def merge(parts: Sequence[Path], out: Path) -> int:
    """Copy outputs and rows of the parts into `out`; files on one disk are linked. Returns the number of rows.

    A clip that is done in one part and failed in another is done. Running it again continues.

    Raises:
        UsageError: a part holds no manifest, or two parts made the same clip from other inputs or settings.
        OutputError: `out` cannot be written.
    """
    for part in parts:
        if not (part / NAME).is_file():
            raise UsageError(f"{part} holds no {NAME}")
    with locked_folder(out) as target, Manifest(target) as whole:
        rows = {row.key: row for row in whole.rows()}
        for part in parts:
            with Manifest(part) as manifest:
                for row in manifest.rows():
                    rows[row.key] = _better(rows.get(row.key), row, part)
            _copy(part, target)
        for key in sorted(rows):
            whole.put(rows[key])
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
        if path.is_dir() or path.name.startswith((".", NAME)) or inner.as_posix() in OWN or len(inner.parts) == 1:
            continue
        place = target / inner
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot make the folder {place.parent}: {error.strerror or error}") from error
        with replacing(place) as scratch:
            _link(path, scratch)


def _link(path: Path, scratch: Path) -> None:
    """Link a file to a temporary name, or copy it to another disk."""
    scratch.unlink()
    try:
        os.link(path, scratch)
    except OSError:
        shutil.copyfile(path, scratch)
