"""`mend`: touch-ups of a trajectory, as the viewer makes them, from a file."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import (
    Force,
    Frames,
    Freeze,
    Json,
    Limits,
    Only,
    Overrides,
    Quiet,
    RobotName,
    TrajectoryFile,
    Up,
)
from robot_retarget.cli.stages import load, own_unmet, read_clip, require_source

commands: typer.Typer = typer.Typer()


@commands.command(
    epilog="Example: robot-retarget mend dance.npz -r op3 --motion dance.bvh --edges EDITS.toml -o mended.npz"
)
def mend(
    trajectory: TrajectoryFile,
    robot: RobotName,
    motion: Annotated[Path, typer.Option(help="The clip it came from.")],
    edges: Annotated[Path, typer.Option(help="EDITS.toml, as the viewer saves it; made in the order they stand.")],
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")],
    frames: Frames = None,
    up: Up = None,
    map_file: Overrides = None,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Solve the frames around each edit again, as `view` does. Exit code 1 if a hard edge of the file is not met."""
    from robot_retarget.edit.session import graph_of
    from robot_retarget.edit.touchup import apply_edits
    from robot_retarget.files import require_writable
    from robot_retarget.formats import load_trajectory
    from robot_retarget.graph.edits import read_edits

    require_writable(output)
    model, edits = load(robot, limits, None, freeze, only), read_edits(edges)
    played, clip = load_trajectory(trajectory, model), read_clip(motion, frames, up=up)
    require_source(played, clip, force)
    made, outcomes = apply_edits(graph_of(clip, model, played, map_file), played, edits)
    made.save(output)
    reached = [outcome.reached for outcome in outcomes if outcome.reached]
    unmet = own_unmet(edge for outcome in outcomes for edge in outcome.unmet)
    facts = {"output": str(output), "edits": len(edits), "reached": reached, "unmet": unmet}
    console.show_result(facts, "\n".join([*reached, *unmet, f"wrote {output}; simulate it before you play it"]), json)
    if unmet:
        raise typer.Exit(1)
