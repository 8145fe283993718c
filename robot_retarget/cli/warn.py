"""`warn`: self-collisions foreseen."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Json, Limits, Quiet, RobotName, TrajectoryFile
from robot_retarget.cli.stages import draw_warnings, load

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget warn dance.npz --robot op3 --plot warnings.png")
def warn(
    trajectory: TrajectoryFile,
    robot: RobotName,
    horizon: Annotated[
        float, typer.Option(help="How far ahead joints continue [s]; 0.2 for smooth machine motion.")
    ] = 1 / 30,
    output: Annotated[
        Path | None, typer.Option("-o", "--out", "--output", help="A table of the events to write (.csv).")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="A picture of D, distance and α to draw.")] = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Foresee a trajectory's self-collisions, frame by frame, and say what came of each warning."""
    from robot_retarget.collision.events import figures_of, write_csv
    from robot_retarget.collision.warn import WarnOptions, warnings_of
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.trajectory import load_trajectory
    from robot_retarget.view.approaches import require_drawable

    for path in filter(None, (output, plot)):
        require_writable(path)
    if output is not None:
        require_suffix(output, ".csv", "--json prints the events as JSON")
    if plot is not None:
        require_drawable(plot)
    options = WarnOptions(horizon=horizon)
    found = warnings_of(load_trajectory(trajectory), load(robot, limits), options)
    if output is not None:
        write_csv(found.events, output)
    figures = figures_of(found.events, len(found), found.fps)
    if json:
        console.dump({"events": [event.contract() for event in found.events], "figures": figures})
    else:
        console.show_warnings([event.contract() for event in found.events], figures)
    if output is not None:
        console.note(f"wrote {output}")
    if plot is not None:
        draw_warnings(found, plot)
