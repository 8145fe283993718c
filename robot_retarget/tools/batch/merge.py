"""Join the folders of several shards into one."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from robot_retarget.base.errors import OutputError, UsageError
from robot_retarget.base.files import replacing
from robot_retarget.tools.batch.manifest import INDEX, NAME, Manifest
from robot_retarget.tools.batch.run import LOCK, locked_folder
from robot_retarget.tools.batch.task import DONE, Row

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
