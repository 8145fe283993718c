"""`batch`: many clips onto many robots."""

import os
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from robot_retarget.base.choices import Balance
from robot_retarget.base.errors import OutputError, UsageError, known
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options

if TYPE_CHECKING:
    from robot_retarget.tools.batch.filters import Chosen, Filter
    from robot_retarget.tools.batch.run import RunPlan, RunSummary
    from robot_retarget.tools.batch.task import Job, Settings, Shard

MERGE = "merge"
RETRIES = ("failed", "timeout", "memory", "crashed")


@options
class BatchOptions(
    opt.FollowOptions,
    opt.FreezeOptions,
    opt.LimitOptions,
    opt.RateOptions,
    opt.MapOptions,
    opt.PartOptions,
    opt.StandOptions,
):
    """Which clips are retargeted onto which robots, how, and where the results go."""

    folders: list[Path] = argument("Folders of motions; or merge, and folders of results.")
    out: Path = option("Folder for the results; running again continues.", *opt.OUT)
    robot: list[str] | None = option("As for solve; several --robot for several robots.", "--robot", "-r", default=None)
    include: list[str] | None = option("Pattern of paths below a folder, such as '*walk*'.", default=None)
    exclude: list[str] | None = option("Pattern of paths to leave out.", default=None)
    jobs: int = option("Processes, of one thread each.", "--jobs", "-j", default=os.cpu_count() or 1, min=1)
    engine: Literal["local", "ray"] = option(
        "Processes of this machine, or a Ray cluster (extra cluster): that of RAY_ADDRESS, or one that starts here.",
        default="local",
    )
    shard: str | None = option("I/N: every N-th clip, I from 0 to N - 1.", default=None)
    retry: list[str] | None = option(f"Repeat clips of a state: {', '.join(RETRIES)}.", default=None)
    timeout: float = option("Seconds that a clip may take.", default=3600.0, min=0.001)
    memory: float = option("GiB of memory that a process may take.", default=2.0, min=0.01)
    dry_run: bool = option("Print the number of clips; run nothing.", "--dry-run", default=False)
    format: list[str] | None = option("Additional format to write; see export --list.", "--format", "-f", default=None)
    pack: list[str] | None = option("Format to pack all clips into: locomujoco, phc (SONIC).", default=None)
    mirror: bool = option("Write the mirror image of every trajectory too.", "--mirror", default=False)
    filter_file: Path | None = option("TOML file of thresholds; by default the shipped ones.", "--filter", default=None)
    pictures: int = option("Number of clips to draw that are left out, and that pass.", default=2, min=0)
    balance: Balance = option(opt.BALANCE, default="off")

    def settings(self) -> "Settings":
        """Return what determines the outputs."""
        from robot_retarget.tools.batch.task import Settings

        given = {each.name: getattr(self, each.name) for each in fields(Settings) if hasattr(self, each.name)}
        given |= {"freeze": tuple(self.freeze or ()), "map_file": _text(self.map_file), "limits": _text(self.limits)}
        return Settings(**given, formats=tuple(self.format or ()))

    def job(self) -> "Job":
        """Return the work to do."""
        from robot_retarget.tools.batch.task import Allowance, Job

        allowed, retry = Allowance(self.timeout, self.memory), tuple(self.retry or ())
        include, exclude = tuple(self.include or ()), tuple(self.exclude or ())
        what = (tuple(self.folders), tuple(self.robot or ()), self.out, self.settings())
        return Job(*what, allowed, include, exclude, _shard(self.shard), retry)


@command(
    epilog="Example: robot-retarget batch mocap --robot op3 --out set; robot-retarget batch merge set_1 set_2 --out set",
)
def batch(how: BatchOptions, printing: opt.PrintOptions) -> None:
    """Retarget and score every motion below some folders.

    A manifest lets a stopped run continue.
    """
    from robot_retarget.formats import FORMATS
    from robot_retarget.tools.batch.filters import SHIPPED, read_filters
    from robot_retarget.tools.batch.manifest import Manifest
    from robot_retarget.tools.batch.report import PACKED
    from robot_retarget.tools.batch.run import plan_of

    if how.folders[0] == Path(MERGE) and not how.folders[0].exists():
        _merge(how.folders[1:], how.out, printing)
        return
    if not how.robot:
        raise UsageError("--robot is missing: a shipped name (op3), an MJCF file, or a robot_descriptions name")
    allowed = ("format", how.format, FORMATS), ("pack", how.pack, PACKED), ("retry", how.retry, RETRIES)
    for name, given, names in allowed:
        if strange := [each for each in given or () if each not in names]:
            raise UsageError(f"--{name}: {strange[0]!r}; {known(names, 40, typed=strange[0])}")
    job, filters = how.job(), list(read_filters(how.filter_file or SHIPPED).values())
    if how.dry_run:
        plan = plan_of(job, Manifest(job.out))
        facts = {"tasks": len(plan.tasks), "kept": plan.kept, "outdated": plan.outdated}
        printing.result(facts, _plan_line(plan))
        return
    ended, chosen = _run(job, how, filters)
    _show(job, ended, chosen, printing)
    raise typer.Exit(130 if ended.stopped else 1 if ended.failures else 0)


def _run(job: "Job", how: BatchOptions, filters: "list[Filter]") -> "tuple[RunSummary, list[Chosen]]":
    """Perform a job with a bar, stopped gently by the first Ctrl-C and at once by the second."""
    from robot_retarget.servo.host import Interrupts
    from robot_retarget.tools.batch.manifest import Manifest, locked_folder
    from robot_retarget.tools.batch.pool import run_local, run_ray
    from robot_retarget.tools.batch.report import pack_all, write_reports
    from robot_retarget.tools.batch.run import perform_all, plan_of, reason
    from robot_retarget.tools.cli.console import tally

    interrupts = Interrupts()
    with locked_folder(job.out) as out:
        manifest = Manifest(out)
        plan = plan_of(job, manifest)
        console.to_stderr(_plan_line(plan))
        for kind in sorted({path.suffix.lower() for path in plan.unread}):
            files = [path for path in plan.unread if path.suffix.lower() == kind]
            console.note(f"{len(files)} {kind} left out: {reason(files[0])}")

        def stopping() -> bool:
            if interrupts.count > 1:
                raise KeyboardInterrupt(f"finished clips are kept in {out}; run it again to continue")
            return interrupts.count > 0

        engine = run_ray if how.engine == "ray" else partial(run_local, jobs=how.jobs)
        with interrupts.listening(), tally(len(plan.tasks), stopping) as report:
            ended = perform_all(plan, manifest, job, engine, lambda outcome: report(outcome.state == "done"), stopping)
        every = list(manifest.rows())
        rows = [row for row in every if plan.is_current(row)]
        if len(rows) < len(every):
            console.note(
                f"{len(every) - len(rows)} rows are not in the lists: their clips are gone, or they were made with other options"
            )
        chosen = write_reports(rows, filters, job, 0 if ended.stopped else how.pictures)
        for format in how.pack or ():
            console.note(f"packed {pack_all(rows, job, format)}")
    return ended, chosen


def _plan_line(plan: "RunPlan") -> str:
    anew = f", {plan.outdated} of them repeated: their clip or the settings changed" if plan.outdated else ""
    return f"{plan.total} clips × robots: {plan.kept} finished, {len(plan.tasks)} to do{anew}"


def _show(job: "Job", ended: "RunSummary", chosen: "list[Chosen]", printing: opt.PrintOptions) -> None:
    if printing.json:
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


def _merge(parts: list[Path], out: Path, printing: opt.PrintOptions) -> None:
    from robot_retarget.tools.batch.manifest import merge

    if not parts:
        raise UsageError("merge takes folders of results: batch merge A B --out ALL")
    count = merge(parts, out)
    printing.result({"out": str(out), "rows": count}, f"{count} rows in {out}; run batch on it again for the summary")


def _shard(text: str | None) -> "Shard":
    from robot_retarget.tools.batch.task import Shard

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
