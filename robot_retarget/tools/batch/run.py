"""A run of `batch`: find clips, skip finished ones, perform the others, write the index."""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from hashlib import sha256
from pathlib import Path

from robot_retarget.base.errors import MotionError, OutputError, UsageError
from robot_retarget.human.capture import FileHeader, Request
from robot_retarget.human.readers.table import FORMATS, REFUSED, format_of
from robot_retarget.robot.model import robot_sha256
from robot_retarget.tools.batch.manifest import COLUMNS, Manifest
from robot_retarget.tools.batch.pool import Report, Stopping
from robot_retarget.tools.batch.task import (
    DONE,
    MIRROR,
    UNWRITABLE,
    Allowance,
    Job,
    Row,
    Settings,
    Task,
    TaskResult,
    robot_of,
)
from robot_retarget.trajectory import KEYS

# The clips below some folders: every file that a reader of motions knows.

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
    folders: Iterable[Path],
    include: tuple[str, ...] = (),
    exclude: tuple[str, ...] = (),
    out: Path | None = None,
    unread: list[Path] | None = None,
) -> list[MotionFile]:
    """All clips below the folders, sorted by name.

    Two files that differ in their suffix only keep it in their names: `walk.bvh`, `walk.npz`.

    Args:
        include: patterns of paths below a folder (`*walk*`); by default every file.
        exclude: patterns of paths to leave out.
        out: the folder of the results, which holds no clips.
        unread: gets the motion files of known formats that are not read.

    Raises:
        UsageError: a folder does not exist, no clip is found, or two clips have one name.
    """
    found: list[tuple[Path, Path]] = []
    unread = [] if unread is None else unread
    for folder in folders:
        if not folder.exists():
            raise UsageError(f"no folder {folder}")
        files = [folder] if folder.is_file() else sorted(_files_below(folder))
        root = folder.parent if folder.is_file() else folder
        wanted = [path for path in files if _wanted(path, root, include, exclude, out)]
        found += [(root, path) for path in wanted if _is_motion(path)]
        unread += [path for path in wanted if is_unread(path)]
    if not found and unread:
        raise UsageError(f"no motion files that are read below {', '.join(map(str, folders))}: {reason(unread[0])}")
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
    first = all(path < other for other in chosen.beside(path) if other.suffix == path.suffix)
    return first and chosen in FORMATS and not set(KEYS) <= FileHeader(path).arrays and not _describes(path)


def is_unread(path: Path) -> bool:
    """Whether a file holds a motion in a known format that is not read; the skeleton of an AMC holds none."""
    endings = {ending for one in REFUSED for ending in one.suffixes} - {".asf"}
    return path.suffix.lower() in endings and format_of(path) in REFUSED


def reason(path: Path) -> str:
    """Return why a motion file is not read, and what to do."""
    try:
        format_of(path).read(path, Request())
    except MotionError as error:
        return str(error)
    return ""


def _describes(path: Path) -> bool:
    """Whether a JSON file describes the file of the same name without `.json`."""
    return path.suffix.lower() == ".json" and path.with_suffix("").is_file()


Engine = Callable[[Sequence[Task], Allowance, Report, Stopping], None]
"""Performs tasks and reports each outcome: `pool.run_local`, `pool.run_ray`."""


@dataclass(frozen=True)
class RunPlan:
    """The tasks of a run."""

    tasks: tuple[Task, ...]
    clips: dict[str, MotionFile]
    """By name."""
    digests: dict[tuple[str, str], str]
    """Of what every clip of the folders is made from, by robot and clip."""
    outdated: int
    """Rows whose clip, robot or settings have changed; they are repeated."""
    unread: tuple[Path, ...] = ()
    """Motion files of known formats that are not read."""

    @property
    def keys(self) -> set[tuple[str, str]]:
        """Robot and clip of everything that this run is to do or has done."""
        return {key for key in self.digests if key[1] in self.clips}

    @property
    def total(self) -> int:
        """The number of clips times robots."""
        return len(self.keys)

    @property
    def kept(self) -> int:
        """Finished rows of the run."""
        return self.total - len(self.tasks)

    def is_current(self, row: Row) -> bool:
        """Whether the clip of a row exists and the row matches its present content and the settings of this run."""
        known = self.digests.get(row.key)
        return Path(row.path).exists() if known is None else known == row.digest


@dataclass(frozen=True)
class RunSummary:
    """How a run ended."""

    states: Counter[str]
    """Of all clips × robots of the run."""
    failures: tuple[Row, ...]
    stopped: bool
    """Whether it was stopped before its end."""


def plan_of(job: Job, manifest: Manifest) -> RunPlan:
    """The tasks of a run that are not done, in the order of clips, then robots.

    Raises:
        UsageError: no clip is found, or two robots have one name.
        RobotError: a robot cannot be loaded.
    """
    unread: list[Path] = []
    clips = find_clips(job.folders, job.include, job.exclude, job.out, unread)
    _require_distinct_images(clips, job.settings)
    own = {clip.name: clip for k, clip in enumerate(clips) if k in job.shard}
    robots = {robot_of(name, job.settings.limits).name: name for name in job.robots}
    if len(robots) < len(job.robots):
        raise UsageError(f"two of the robots {', '.join(job.robots)} have one name")
    made_by = {
        robot: job.settings.digest(robot_sha256(robot_of(name, job.settings.limits))) for robot, name in robots.items()
    }
    there = {row.key: row for row in manifest.rows()}
    digests, tasks, outdated = dict[tuple[str, str], str](), list[Task](), 0
    for clip in clips:
        content = " ".join(map(manifest.sha256, clip.files))
        for robot, name in robots.items():
            digest = sha256(f"{content} {made_by[robot]}".encode()).hexdigest()
            digests[robot, clip.name] = digest
            task = Task(str(clip.path), clip.name, name, robot, digest, str(job.out), job.settings)
            row = there.get((robot, clip.name))
            stays = row and row.digest == digest and _is_kept(row, task, job.retry, manifest)
            lacks = row and row.state == DONE and not all(place.is_file() for *_, place in task.further())
            if clip.name not in own or (stays and not lacks):
                continue
            tasks.append(replace(task, kept=row) if stays else task)
            outdated += row is not None and row.digest != digest
    return RunPlan(tuple(tasks), own, digests, outdated, tuple(unread))


def perform_all(
    plan: RunPlan, manifest: Manifest, job: Job, engine: Engine, report: Report, stopping: Stopping
) -> RunSummary:
    """Perform the tasks of a plan and keep every outcome in the manifest.

    Raises:
        OutputError: an output cannot be written, for example on a full disk; finished rows are kept.
    """
    trouble = list[str]()

    def keep(outcome: TaskResult) -> None:
        if outcome.state == UNWRITABLE:
            trouble.append(outcome.message)
            return
        row = Row(**{name: getattr(outcome, name) for name in COLUMNS})
        manifest.put(replace(row, path=str(plan.clips[outcome.clip].path)))
        manifest.time(outcome)
        report(outcome)

    if plan.tasks:
        engine(plan.tasks, job.allowance, keep, lambda: bool(trouble) or stopping())
    if trouble:
        raise OutputError(f"{trouble[0]}; finished clips are kept: run it again to continue")
    manifest.save_index()
    rows = [row for row in manifest.rows() if row.key in plan.keys and plan.is_current(row)]
    failures = tuple(row for row in rows if row.state != DONE)
    return RunSummary(Counter(row.state for row in rows), failures, len(rows) < plan.total)


def _require_distinct_images(clips: Sequence[MotionFile], settings: Settings) -> None:
    """Refuse a clip that has the name of another's mirror image."""
    names = {clip.name for clip in clips} if settings.mirror else set[str]()
    for name in sorted(names):
        if f"{name}{MIRROR}" in names:
            raise UsageError(
                f"the mirror image of {name} would overwrite {name}{MIRROR}: rename it or leave it out (exclude), or do without mirror"
            )


def _is_kept(row: Row, task: Task, retry: tuple[str, ...], manifest: Manifest) -> bool:
    """Whether a row stays: a failure that is not retried, or an output that is as it was written."""
    if row.state != DONE:
        return row.state not in retry
    return task.output.is_file() and manifest.sha256(task.output) == row.output_sha256
