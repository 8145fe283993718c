"""`batch`: many clips onto many robots."""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import (
    Balance,
    Fps,
    Frames,
    Freeze,
    Json,
    Legs,
    Limits,
    Only,
    Overrides,
    Preset,
    Quiet,
    Repair,
    Up,
)
from robot_retarget.errors import OutputError, UsageError, known

if TYPE_CHECKING:
    from robot_retarget.batch.filters import Chosen, Filter
    from robot_retarget.batch.run import Engine, RunPlan, RunSummary
    from robot_retarget.batch.settings import Job, Shard

commands: typer.Typer = typer.Typer()
MERGE = "merge"
RETRIES = ("failed", "timeout", "memory", "crashed")


@commands.command(
    epilog="Example: robot-retarget batch mocap --robot op3 --out set; robot-retarget batch merge set_1 set_2 --out set"
)
def batch(
    folders: Annotated[list[Path], typer.Argument(help="Folders of motions; or merge, and folders of results.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", "--output", help="Folder for the results; running again continues.")
    ],
    robot: Annotated[
        list[str] | None, typer.Option("--robot", "-r", help="As for solve; several --robot for several robots.")
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Pattern of paths below a folder, such as '*walk*'.")
    ] = None,
    exclude: Annotated[list[str] | None, typer.Option(help="Pattern of paths to leave out.")] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Processes, of one thread each.")] = os.cpu_count()
    or 1,
    engine: Annotated[
        Literal["local", "ray"], typer.Option(help="Processes of this machine, or a Ray cluster (extra cluster).")
    ] = "local",
    address: Annotated[str | None, typer.Option(help="Of the Ray cluster; without one, Ray starts here.")] = None,
    shard: Annotated[str | None, typer.Option(help="I/N: every N-th clip, I from 0 to N - 1.")] = None,
    retry: Annotated[list[str] | None, typer.Option(help=f"Repeat clips of a state: {', '.join(RETRIES)}.")] = None,
    timeout: Annotated[float, typer.Option(min=0.001, help="Seconds that a clip may take.")] = 3600.0,
    memory: Annotated[float, typer.Option(min=0.01, help="GiB of memory that a process may take.")] = 2.0,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the number of clips and an estimate of the time; run nothing.")
    ] = False,
    format: Annotated[
        list[str] | None, typer.Option("--format", "-f", help="Additional format to write; see export --list.")
    ] = None,
    pack: Annotated[
        list[str] | None, typer.Option(help="Format to pack all clips into: locomujoco, phc (SONIC).")
    ] = None,
    mirror: Annotated[bool, typer.Option("--mirror", help="Write the mirror image of every trajectory too.")] = False,
    filter_file: Annotated[
        Path | None, typer.Option("--filter", help="TOML file of thresholds; by default the shipped ones.")
    ] = None,
    extremes: Annotated[int, typer.Option(min=0, help="Number of worst and of best clips to draw.")] = 2,
    frames: Frames = None,
    fps: Fps = None,
    up: Up = None,
    repair: Repair = True,
    map_file: Overrides = None,
    limits: Limits = None,
    freeze: Freeze = None,
    only: Only = None,
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "off",
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Retarget and score every motion below some folders; a manifest lets a stopped run continue."""
    from robot_retarget.batch.filters import SHIPPED, read_filters
    from robot_retarget.batch.settings import Allowance, Job, Settings

    if folders[0] == Path(MERGE) and not folders[0].exists():
        _merge(folders[1:], out, json)
        return
    if not robot:
        raise UsageError("--robot is missing: a shipped name (op3), an MJCF file, or a robot_descriptions name")
    _require(format, pack, retry)
    settings = Settings(
        fps,
        preset,
        legs,
        balance,
        frames,
        up,
        repair,
        tuple(format or ()),
        mirror,
        _text(map_file),
        _text(limits),
        tuple(freeze or ()),
        only,
    )
    job = Job(
        tuple(folders), tuple(robot), out, settings, Allowance(timeout, memory), tuple(include or ()), tuple(exclude or ()),
        _shard(shard), tuple(retry or ()),
    )  # fmt: skip
    filters = list(read_filters(filter_file or SHIPPED).values())
    if dry_run:
        _estimate(job, jobs, json)
        return
    ended, chosen = _run(job, _engine(engine, jobs, address), filters, extremes, pack or [])
    _tell(job, ended, chosen, json)
    raise typer.Exit(130 if ended.stopped else 1 if ended.failures else 0)


def _run(
    job: "Job", engine: "Engine", filters: "list[Filter]", extremes: int, pack: list[str]
) -> "tuple[RunSummary, list[Chosen]]":
    """Perform a job with a bar, stopped gently by the first Ctrl-C and at once by the second."""
    from robot_retarget.batch.manifest import Manifest
    from robot_retarget.batch.pack import pack_all
    from robot_retarget.batch.report import write_reports
    from robot_retarget.batch.run import locked_folder, perform_all, plan_of
    from robot_retarget.cli.bars import tally
    from robot_retarget.servo.interrupts import Interrupts

    interrupts = Interrupts()
    with locked_folder(job.out) as out, Manifest(out) as manifest:
        for sentence in manifest.notes:
            console.note(sentence)
        plan = plan_of(job, manifest)
        _say_plan(plan)

        def stopping() -> bool:
            if interrupts.count > 1:
                raise KeyboardInterrupt(f"finished clips are kept in {out}; run it again to continue")
            return interrupts.count > 0

        with interrupts.listening(), tally(len(plan.tasks), stopping) as told:
            ended = perform_all(plan, manifest, job, engine, lambda outcome: told(outcome.state == "done"), stopping)
        every = list(manifest.rows())
        rows = [row for row in every if plan.is_current(row)]
        if len(rows) < len(every):
            console.note(
                f"{len(every) - len(rows)} rows are not in the lists: their clips are gone, or they were made with other options"
            )
        chosen = write_reports(rows, filters, job, 0 if ended.stopped else extremes)
        for format in pack:
            console.note(f"packed {pack_all(rows, job, format)}")
    return ended, chosen


def _engine(name: str, jobs: int, address: str | None) -> "Engine":
    from robot_retarget.batch.cluster import run_ray
    from robot_retarget.batch.pool import run_local

    return partial(run_ray, address=address) if name == "ray" else partial(run_local, jobs=jobs)


def _say_plan(plan: "RunPlan") -> None:
    anew = f", {plan.outdated} of them repeated: their clip or the settings changed" if plan.outdated else ""
    console.to_stderr(f"{plan.total} clips × robots: {plan.kept} finished, {len(plan.tasks)} to do{anew}")


def _tell(job: "Job", ended: "RunSummary", chosen: "list[Chosen]", json: bool) -> None:
    if json:
        failures = [{"robot": r.robot, "clip": r.clip, "state": r.state, "message": r.message} for r in ended.failures]
        passed = {one.filter.name: len(one.passed) for one in chosen}
        facts = {"out": str(job.out), "states": dict(ended.states), "stopped": ended.stopped}
        console.dump({**facts, "failures": failures, "filters": passed})
        return
    console.say(", ".join(f"{count} {state}" for state, count in sorted(ended.states.items())) or "nothing done")
    rows = [(r.state, r.robot, r.clip, r.message) for r in ended.failures]
    if rows:
        console.table("\nNot done", ("state", "robot", "clip", "because"), rows)
    total = sum(len(one.passed) + len(one.rejected) for one in chosen[:1])
    console.table("Filters", ("filter", "passed", "of"), [(one.filter.name, len(one.passed), total) for one in chosen])
    console.say(f"wrote summary.html, summary.csv, index.jsonl and lists/ in {job.out}")


def _estimate(job: "Job", jobs: int, json: bool) -> None:
    """Print the number of tasks and their estimated duration. Only the manifest of an existing folder is touched."""
    import tempfile

    from robot_retarget.batch.estimate import estimate
    from robot_retarget.batch.manifest import NAME, Manifest
    from robot_retarget.batch.run import plan_of

    with tempfile.TemporaryDirectory() as scratch:
        place = job.out if (job.out / NAME).is_file() else Path(scratch)
        with Manifest(place) as manifest:
            found = estimate(plan_of(job, manifest), manifest)
    if json:
        console.dump({**vars(found), "jobs": jobs, "hours": round(found.hours(jobs), 3)})
        return
    by = "measured on this folder" if found.measured else "a G1 at 30 frames/s on a core of 2.5 GHz"
    console.say(f"{found.tasks} clips × robots to do, {found.kept} finished")
    console.say(
        f"{found.motion_seconds / 3600:.2f} h of motion, about {found.hours(jobs):.2f} h on {jobs} processes ({by})"
    )


def _merge(parts: list[Path], out: Path, json: bool) -> None:
    from robot_retarget.batch.merge import merge

    if not parts:
        raise UsageError("merge takes folders of results: batch merge A B --out ALL")
    count = merge(parts, out)
    console.show_result(
        {"out": str(out), "rows": count}, f"{count} rows in {out}; run batch on it again for the summary", json
    )


def _require(format: list[str] | None, pack: list[str] | None, retry: list[str] | None) -> None:
    from robot_retarget.batch.pack import PACKED
    from robot_retarget.formats import FORMATS

    for option, given, names in (("--format", format, FORMATS), ("--pack", pack, PACKED), ("--retry", retry, RETRIES)):
        strange = [name for name in given or () if name not in names]
        if strange:
            raise UsageError(f"{option}: {strange[0]!r}; {known(names, 40, typed=strange[0])}")


def _shard(text: str | None) -> "Shard":
    from robot_retarget.batch.settings import Shard

    if text is None:
        return Shard()
    index, _, count = text.partition("/")
    if not (index.isdigit() and count.isdigit() and int(index) < int(count)):
        raise UsageError(f"--shard takes I/N with I from 0 to N - 1, got {text!r}")
    return Shard(int(index), int(count))


def _text(path: Path | None) -> str | None:
    if path is not None and not path.is_file():
        raise OutputError(f"there is no file {path}")
    return None if path is None else str(path)
