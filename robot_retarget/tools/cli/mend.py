"""`mend`: touch-ups of a trajectory, as the viewer makes them, from a file."""

from pathlib import Path

import typer

from robot_retarget.tools.cli.command import command, option, options
from robot_retarget.tools.cli.options import (
    ForceOptions,
    FreezeOptions,
    MapOptions,
    OutputOptions,
    PrintOptions,
    ReadOptions,
    RobotOptions,
    TrajectoryOptions,
)
from robot_retarget.tools.cli.stages import require_source

commands: typer.Typer = typer.Typer()


@options
class MendOptions(ForceOptions, MapOptions, ReadOptions, OutputOptions, TrajectoryOptions):
    """A trajectory, the clip it came from, and its edits."""

    motion: Path = option("The clip it came from.")
    edges: Path = option("EDITS.toml, as the viewer saves it; made in the order they stand.")


@command(
    commands, epilog="Example: robot-retarget mend dance.npz -r op3 --motion dance.bvh --edges EDITS.toml -o mended.npz"
)
def mend(edited: MendOptions, robot: RobotOptions, frozen: FreezeOptions, printing: PrintOptions) -> None:
    """Solve the frames around each edit again, as `view` does. Exit code 1 if a hard edge of the file is not met."""
    from robot_retarget.base.files import require_writable
    from robot_retarget.edit.touchup import apply_edits, graph_of
    from robot_retarget.formats import load_trajectory
    from robot_retarget.graph.edits import read_edits
    from robot_retarget.solver.solution import unmet_of_user

    require_writable(edited.output)
    model, edits = frozen.of(robot.load()), read_edits(edited.edges)
    played, clip = load_trajectory(edited.trajectory, model), edited.read(edited.motion)
    require_source(played, clip, edited.force)
    made, outcomes = apply_edits(graph_of(clip, model, played, edited.map_file), played, edits)
    made.save(edited.output)
    reached = [outcome.reached for outcome in outcomes if outcome.reached]
    unmet = unmet_of_user(edge for outcome in outcomes for edge in outcome.unmet)
    facts = {"output": str(edited.output), "edits": len(edits), "reached": reached, "unmet": unmet}
    wrote = f"wrote {edited.output}; simulate it before you play it"
    printing.result(facts, "\n".join([*reached, *unmet, wrote]))
    if unmet:
        raise typer.Exit(1)
