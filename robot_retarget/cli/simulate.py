"""`simulate`: a trajectory on simulated servos, and a verdict."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import (
    Draws,
    Feedback,
    Json,
    Limits,
    Quiet,
    RobotName,
    Servos,
    Thresholds,
    TrajectoryFile,
)
from robot_retarget.cli.stages import judged, load, save_judged, warnings_or_none, write_page

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget simulate dance.npz --robot op3 --mode free")
def simulate(
    trajectory: TrajectoryFile,
    robot: RobotName,
    mode: Annotated[
        Literal["auto", "pinned", "free"],
        typer.Option(
            help="pinned (the pelvis is held), free (standing on a floor); auto: free if solved with balance."
        ),
    ] = "auto",
    compensate: Annotated[
        bool, typer.Option(help="Send goals that compensate lag and load, or the trajectory itself.")
    ] = True,
    feedback: Feedback = None,
    backlash: Annotated[
        float, typer.Option(help="Play of every joint, either way [rad]; that of an XM430 is 0.0044 (0.25°).")
    ] = 0.0,
    objects: Annotated[
        Literal["carried", "free"],
        typer.Option(help="Moving bodies of the scene follow their path, or are held by friction alone."),
    ] = "carried",
    servos: Servos = None,
    own_actuators: Annotated[bool, typer.Option("--own-actuators", help="The MJCF's actuators, no servos.")] = False,
    store: Annotated[
        bool, typer.Option(help="Keep the judged goals in the trajectory's file, and write the report of it.")
    ] = True,
    report_file: Annotated[
        Path | None,
        typer.Option(
            "--report",
            help="The report to write; by default report.json (free) or report.pinned.json in the folder of the trajectory.",
        ),
    ] = None,
    draws: Draws = 10,
    thresholds: Thresholds = None,
    page: Annotated[Path | None, typer.Option(help="A page with charts to write (.html).")] = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Play a trajectory on simulated servos and pass a verdict; the goals that were judged are kept for `play`."""
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.report_file import NAMES
    from robot_retarget.simulate.rollout import mode_of
    from robot_retarget.trajectory import load_trajectory
    from robot_retarget.view import loop

    if page is not None:
        require_suffix(page, ".html", "--json prints the report as JSON")
    model, played = load(robot, limits, servos), load_trajectory(trajectory)
    how = mode_of(played) if mode == "auto" else mode
    where = report_file or trajectory.with_name(NAMES[how])
    for path in (*([trajectory, where] if store else []), *([page] if page else [])):
        require_writable(path)
    warnings = warnings_or_none(played, model)
    report = judged(
        played, model, how, compensate, not own_actuators, thresholds, warnings, draws, feedback, backlash, objects
    )
    if store:
        save_judged(report, trajectory, where)
    if page is not None:
        write_page(report, report.trajectory or played, warnings, page, film=loop(model, played))
    if json:
        console.dump(report.contract())
    else:
        console.show_report(report)
    raise typer.Exit(0 if report.verdict == "pass" else 1)
