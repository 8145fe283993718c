"""Small batches: clips of half a second cut from the samples, and engines of one process."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.tools.batch.manifest import Manifest, locked_folder
from robot_retarget.tools.batch.pool import Report, Stopping
from robot_retarget.tools.batch.run import Engine, RunSummary, perform_all, plan_of
from robot_retarget.tools.batch.task import Allowance, Job, Row, Task, TaskResult, perform

FRAMES = 12


def cut_clips(folder: Path, names: Sequence[str] = ("wave", "walk", "clap")) -> Path:
    """A folder of short clips."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        motion = rr.read_motion(ROOT / f"samples/{name}.bvh")
        rr.write_bvh(motion.frames(20, 20 + FRAMES), folder / f"{name}.bvh")
    return folder


def here(tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping) -> None:
    """An engine without processes."""
    for task in tasks:
        if not stopping():
            report(perform(task))


def pretend(tasks: Sequence[Task], allowance: Allowance, report: Report, stopping: Stopping) -> None:
    """An engine that retargets nothing: for laws of the manifest alone."""
    for task in tasks:
        if not stopping():
            task.output.parent.mkdir(parents=True, exist_ok=True)
            task.output.write_bytes(task.digest.encode())
            digest = hashlib.sha256(task.digest.encode()).hexdigest()
            report(
                TaskResult(task.robot_name, task.clip, task.digest, "done", frames=10, fps=30.0, output_sha256=digest)
            )


def job_of(folder: Path, out: Path, **more: object) -> Job:
    return replace(Job((folder,), ("op3",), out), **more)  # type: ignore[arg-type]


def run(job: Job, engine: Engine = here, stop_after: int | None = None) -> tuple[RunSummary, list[TaskResult]]:
    """Perform a job; what was reported."""
    reported: list[TaskResult] = []

    def stopping() -> bool:
        return stop_after is not None and len(reported) >= stop_after

    with locked_folder(job.out) as out:
        manifest = Manifest(out)
        ended = perform_all(plan_of(job, manifest), manifest, job, engine, reported.append, stopping)
    return ended, reported


def rows_of(out: Path) -> list[Row]:
    return list(Manifest(out).rows())


def contents(out: Path) -> dict[str, bytes]:
    """Every output of a batch and its index, by name."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and not path.name.startswith((".", "times.jsonl"))
    }
