"""`simulate`: a trajectory on simulated servos, and a verdict."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Json, Limits, RobotName, Thresholds, TrajectoryFile
from robot_retarget.cli.stages import foreseen, judged, load, write_page

commands = typer.Typer()


@commands.command(epilog="Example: robot-retarget simulate dance.npz --robot op3 --mode free")
def simulate(
    trajectory: TrajectoryFile,
    robot: RobotName,
    mode: Annotated[
        Literal["pinned", "free"], typer.Option(help="pinned (the pelvis is held) or free (standing on a floor).")
    ] = "pinned",
    compensate: Annotated[
        bool, typer.Option(help="Send goals that make up for lag and load, or the trajectory as it is.")
    ] = True,
    servos: Annotated[
        bool,
        typer.Option("--servos/--own-actuators", help="Servos by the robot's servos.toml, or the MJCF's actuators."),
    ] = True,
    thresholds: Thresholds = None,
    page: Annotated[Path | None, typer.Option(help="A page with charts to write (.html).")] = None,
    limits: Limits = None,
    json: Json = False,
) -> None:
    """Play a trajectory on simulated servos and pass a verdict."""
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.trajectory import load_trajectory

    if page is not None:
        require_suffix(page, ".html", "--json prints the report as JSON")
        require_writable(page)
    model, played = load(robot, limits), load_trajectory(trajectory)
    warnings = foreseen(played, model)
    report = judged(trajectory, model, mode, compensate, servos, thresholds, warnings)
    if page is not None:
        write_page(report, trajectory, warnings, page)
    if json:
        console.dump(report.contract())
    else:
        console.show_report(report.contract())
    raise typer.Exit(0 if report.verdict == "pass" else 1)
