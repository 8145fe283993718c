"""A run of `batch`: find clips, skip finished ones, perform the others, write the index."""

import fcntl
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from robot_retarget.batch.clips import MotionFile, find_clips
from robot_retarget.batch.manifest import NAME, Manifest, Row
from robot_retarget.batch.pool import Report, Stopping
from robot_retarget.batch.settings import Allowance, Job, sha256_of
from robot_retarget.batch.task import DONE, UNWRITABLE, Task, TaskResult, robot_of
from robot_retarget.errors import OutputError, UsageError
from robot_retarget.files import folder

Engine = Callable[[Sequence[Task], Allowance, Report, Stopping], None]
"""Performs tasks and reports each outcome: `pool.run_local`, `cluster.run_ray`."""
LOCK = ".lock"
SCRATCH = re.compile(r"\..+-[a-z0-9_]{8}(\..*)?")
"""Temporary names of `files.replacing`."""


@dataclass(frozen=True)
class RunPlan:
    """The tasks of a run."""

    tasks: tuple[Task, ...]
    clips: dict[str, MotionFile]
    """By name."""
    kept: int
    """Finished rows of the run."""
    outdated: int
    """Rows whose clip, robot file or settings have changed; they are repeated."""

    @property
    def total(self) -> int:
        """Clips × robots."""
        return len(self.tasks) + self.kept


@dataclass(frozen=True)
class RunSummary:
    """How a run ended."""

    states: Counter[str]
    """Of all clips × robots of the run."""
    failures: tuple[Row, ...]
    stopped: bool
    """Whether it was stopped before its end."""


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


def plan_of(job: Job, manifest: Manifest) -> RunPlan:
    """The tasks of a run that are not done, in the order of clips, then robots.

    Raises:
        UsageError: no clip is found, or two robots have one name.
        RobotError: a robot cannot be loaded.
    """
    clips = [
        clip for k, clip in enumerate(find_clips(job.folders, job.include, job.exclude, job.out)) if k in job.shard
    ]
    robots = {robot_of(name, job.settings.limits).name: name for name in job.robots}
    if len(robots) < len(job.robots):
        raise UsageError(f"two of the robots {', '.join(job.robots)} have one name")
    made_by = {robot: job.settings.digest(robot_of(name, job.settings.limits).path) for robot, name in robots.items()}
    there = {row.key: row for row in manifest.rows()}
    tasks, outdated = list[Task](), 0
    for clip in clips:
        content = _hashed(clip.path, manifest)
        for robot, name in robots.items():
            digest = sha256(f"{content} {made_by[robot]}".encode()).hexdigest()
            task = Task(str(clip.path), clip.name, name, robot, digest, str(job.out), job.settings)
            row = there.get((robot, clip.name))
            if row is None or row.digest != digest or _again(row, task, job.retry):
                tasks.append(task)
                outdated += row is not None and row.digest != digest
    total = len(clips) * len(robots)
    return RunPlan(tuple(tasks), {clip.name: clip for clip in clips}, total - len(tasks), outdated)


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
        manifest.put(_row(outcome, plan.clips[outcome.clip]))
        manifest.time(outcome)
        report(outcome)

    if plan.tasks:
        engine(plan.tasks, job.allowance, keep, lambda: bool(trouble) or stopping())
    if trouble:
        raise OutputError(f"{trouble[0]}; finished clips are kept: run it again to continue")
    manifest.save_index()
    keys = {(robot_of(name, job.settings.limits).name, clip) for clip in plan.clips for name in job.robots}
    rows = [row for row in manifest.rows() if row.key in keys]
    failures = tuple(row for row in rows if row.state != DONE)
    return RunSummary(Counter(row.state for row in rows), failures, len(rows) < len(keys))


def _hashed(path: Path, manifest: Manifest) -> str:
    known = manifest.known_sha256(path)
    if known is None:
        try:
            known = sha256_of(path)
        except OSError:  # reading it fails later, with a sentence
            return "unreadable"
        manifest.note_sha256(path, known)
    return known


def _again(row: Row, task: Task, retry: tuple[str, ...]) -> bool:
    """Whether a row is made again: its output is gone, or its failure is to be retried."""
    return row.state in retry if row.state != DONE else not task.output.is_file()


def _row(outcome: TaskResult, clip: MotionFile) -> Row:
    common = {name: getattr(outcome, name) for name in Row.__dataclass_fields__ if hasattr(outcome, name)}
    return replace(Row(**common), path=str(clip.path), licence=clip.licence, source=clip.source)
