"""The clips below some folders: every file that a reader of motions knows."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.human.capture import FileHeader
from robot_retarget.human.readers.table import FORMATS, format_of
from robot_retarget.trajectory import KEYS

SIDE_TABLES = ("manifest.csv", "metadata.csv", "licences.csv")
"""Tables of a folder about its files."""


@dataclass(frozen=True)
class MotionFile:
    """One motion file."""

    path: Path
    name: str
    """Its path below its folder, without the suffix: the name of its outputs."""
    beside: tuple[Path, ...] = ()
    """Other files that its reader opens."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that it is read from."""
        return self.path, *self.beside


def find_clips(
    folders: Iterable[Path], include: tuple[str, ...] = (), exclude: tuple[str, ...] = (), out: Path | None = None
) -> list[MotionFile]:
    """All clips below the folders, sorted by name.

    Two files that differ in their suffix only keep it in their names: `walk.bvh`, `walk.npz`.

    Args:
        include: patterns of paths below a folder (`*walk*`); by default every file.
        exclude: patterns of paths to leave out.
        out: the folder of the results, which holds no clips.

    Raises:
        UsageError: a folder does not exist, no clip is found, or two clips have one name.
    """
    found: list[tuple[Path, Path]] = []
    for folder in folders:
        if not folder.exists():
            raise UsageError(f"no folder {folder}")
        files = [folder] if folder.is_file() else sorted(_files_below(folder))
        root = folder.parent if folder.is_file() else folder
        found += [(root, path) for path in files if _wanted(path, root, include, exclude, out) and _is_motion(path)]
    if not found:
        listed = ", ".join(sorted({suffix for one in FORMATS for suffix in one.suffixes}))
        raise UsageError(f"no motion files below {', '.join(map(str, folders))}; known: {listed}")
    return sorted(_named(found), key=lambda clip: clip.name)


def _files_below(folder: Path) -> Iterator[Path]:
    """All files below a folder, through links too; a folder that is reached twice counts once."""
    seen = set[Path]()
    for name, inner, names in os.walk(folder, followlinks=True):
        place = Path(name)
        inner[:] = [one for one in sorted(inner) if (place / one).resolve() not in seen]
        seen |= {(place / one).resolve() for one in inner} | {place.resolve()}
        yield from (place / one for one in names if (place / one).is_file())


def _named(found: list[tuple[Path, Path]]) -> Iterator[MotionFile]:
    bare = Counter(_name(root, path) for root, path in found)
    taken: dict[str, Path] = {}
    for root, path in found:
        name = _name(root, path)
        if bare[name] > 1:
            name += path.suffix.lower()
        if name in taken:
            raise UsageError(
                f"two clips of one name, {name}: {taken[name]} and {path}; leave one out with --exclude, or give their common folder"
            )
        taken[name] = path
        yield MotionFile(path, name, format_of(path).beside(path))


def _name(root: Path, path: Path) -> str:
    return path.relative_to(root).with_suffix("").as_posix()


def _wanted(path: Path, root: Path, include: tuple[str, ...], exclude: tuple[str, ...], out: Path | None) -> bool:
    if out is not None and out.resolve() in path.resolve().parents:
        return False
    inner = path.relative_to(root).as_posix()
    if any(part.startswith(".") for part in Path(inner).parts):
        return False
    kept = not include or any(fnmatch(inner, pattern) for pattern in include)
    return kept and not any(fnmatch(inner, pattern) for pattern in exclude)


def _is_motion(path: Path) -> bool:
    """Whether a reader knows the file, by content or suffix; side tables and robot trajectories are excluded."""
    if path.name in SIDE_TABLES:
        return False
    try:
        chosen = format_of(path)
    except (MotionError, OSError):
        return False
    return chosen in FORMATS and not set(KEYS) <= FileHeader(path).arrays and not _describes(path)


def _describes(path: Path) -> bool:
    """Whether a JSON file describes the file of the same name without `.json`."""
    return path.suffix.lower() == ".json" and path.with_suffix("").is_file()
