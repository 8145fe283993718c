"""`warn`: collisions foreseen."""

from pathlib import Path

import typer

from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import command, option, options
from robot_retarget.tools.cli.options import OUT, PrintOptions, RobotOptions, TrajectoryOptions
from robot_retarget.tools.cli.stages import draw_warnings

commands: typer.Typer = typer.Typer()


@options
class WarnedOptions(TrajectoryOptions):
    """How far ahead to look, and what to write."""

    horizon: float = option("How far ahead joints continue [s]; 0.2 for smooth machine motion.", default=1 / 30)
    output: Path | None = option("A table of the events to write (.csv).", *OUT, default=None)
    plot: Path | None = option("A picture of D, distance and α to draw.", default=None)


@command(commands, epilog="Example: robot-retarget warn dance.npz --robot op3 --plot warnings.png")
def warn(warned: WarnedOptions, robot: RobotOptions, printing: PrintOptions) -> None:
    """Foresee collisions of a trajectory with itself and with the bodies around it, frame by frame, and say what came of each warning."""
    from robot_retarget.base.files import require_suffix, require_writable
    from robot_retarget.collision.events import figures_of, write_csv
    from robot_retarget.collision.warn import WarnOptions, warnings_of
    from robot_retarget.tools.view.charts import require_drawable
    from robot_retarget.trajectory import load_trajectory

    output, plot = warned.output, warned.plot
    for path in filter(None, (output, plot)):
        require_writable(path)
    if output is not None:
        require_suffix(output, ".csv", "--json prints the events as JSON")
    if plot is not None:
        require_drawable(plot)
    found = warnings_of(load_trajectory(warned.trajectory), robot.load(), WarnOptions(horizon=warned.horizon))
    if output is not None:
        write_csv(found.events, output)
    facts = {
        "events": [event.contract() for event in found.events],
        "figures": figures_of(found.events, len(found), found.fps),
    }
    printing.show(facts, console.show_warnings)
    if output is not None:
        console.note(f"wrote {output}")
    if plot is not None:
        draw_warnings(found, plot)
