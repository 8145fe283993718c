"""`simulate`: a trajectory on simulated servos, and a verdict."""

from pathlib import Path
from typing import Literal

import typer

from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.bars import progress
from robot_retarget.tools.cli.command import command, option, options
from robot_retarget.tools.cli.options import JudgeOptions, PrintOptions, RobotOptions, ServoOptions, TrajectoryOptions
from robot_retarget.tools.cli.stages import save_judged, write_page

commands: typer.Typer = typer.Typer()


@options
class SimulateOptions(JudgeOptions, ServoOptions, TrajectoryOptions):
    """Simulation of a trajectory, and the files to write."""

    mode: Literal["auto", "pinned", "free"] = option(
        "pinned (the pelvis is held), free (standing on a floor); auto: free if solved with balance.", default="auto"
    )
    compensate: bool = option("Send goals that compensate lag and load, or the trajectory itself.", default=True)
    backlash: float = option("Play of every joint, either way [rad]; that of an XM430 is 0.0044 (0.25°).", default=0.0)
    objects: Literal["carried", "free"] = option(
        "Moving bodies of the scene follow their path, or are held by friction alone.", default="carried"
    )
    own_actuators: bool = option("The MJCF's actuators, no servos.", "--own-actuators", default=False)
    store: bool = option("Keep the judged goals in the trajectory's file, and write the report of it.", default=True)
    report_file: Path | None = option(
        "The report to write; by default report.json (free) or report.pinned.json in the folder of the trajectory.",
        "--report",
        default=None,
    )
    thresholds: Path | None = option("TOML file with thresholds of the verdict.", default=None)
    page: Path | None = option("A page with charts to write (.html).", default=None)


@command(commands, epilog="Example: robot-retarget simulate dance.npz --robot op3 --mode free")
def simulate(how: SimulateOptions, robot: RobotOptions, printing: PrintOptions) -> None:
    """Play a trajectory on simulated servos and pass a verdict; the goals that were judged are kept for `play`."""
    from robot_retarget.base.files import require_suffix, require_writable
    from robot_retarget.base.untrusted.documents import NAMES
    from robot_retarget.collision.warn import warnings_of
    from robot_retarget.judge.rollout import mode_of
    from robot_retarget.judge.rollout import simulate as roll_out
    from robot_retarget.judge.thresholds import read_thresholds
    from robot_retarget.tools.view.film import loop
    from robot_retarget.trajectory import load_trajectory

    page = how.page
    if page is not None:
        require_suffix(page, ".html", "--json prints the report as JSON")
    model, played = robot.load(how.servos), load_trajectory(how.trajectory)
    mode = mode_of(played) if how.mode == "auto" else how.mode
    where = how.report_file or how.trajectory.with_name(NAMES[mode])
    for path in (*([how.trajectory, where] if how.store else []), *([page] if page else [])):
        require_writable(path)
    warnings = warnings_of(played, model) if len(played) > 1 else None  # a single frame has no next one to warn of
    with progress() as begin:
        report = roll_out(
            played,
            model,
            mode=mode,
            drives=None if how.own_actuators else "auto",
            compensate=how.compensate,
            thresholds=None if how.thresholds is None else read_thresholds(how.thresholds),
            warnings=warnings,
            draws=how.draws,
            feedback=how.feedback,
            backlash=how.backlash,
            objects=how.objects,
            progress=begin("simulate"),
        )
    if how.store:
        save_judged(report, how.trajectory, where)
    if page is not None:
        write_page(report, report.trajectory or played, warnings, page, film=loop(model, played))
    printing.show(report.contract(), lambda _: console.show_report(report))
    raise typer.Exit(0 if report.verdict == "pass" else 1)
