"""`solve`: a motion to a trajectory."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.bars import progress
from robot_retarget.cli.options import (
    Balance,
    BodyModel,
    DefaultRobot,
    Edges,
    Fps,
    Frames,
    Json,
    Legs,
    Limits,
    MotionFile,
    Overrides,
    Preset,
    Quiet,
    Repair,
    SourceFps,
    Up,
)
from robot_retarget.cli.stages import RetargetOptions, load, own_unmet, read_clip, retarget_cost, retargeted

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget solve dance.bvh --robot op3 -o dance.npz")
def solve(
    motion: MotionFile,
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")],
    robot: DefaultRobot = "",
    frames: Frames = None,
    fps: Fps = None,
    source_fps: SourceFps = None,
    body_model: BodyModel = None,
    up: Up = None,
    repair: Repair = True,
    map_file: Overrides = None,
    limits: Limits = None,
    edges: Edges = None,
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    explain: Annotated[bool, typer.Option(help="Print the edges that lost most.")] = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Retarget a motion: the trajectory only. Exit code 1 if a hard edge of --edges is not met."""
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.summary import describe_solution

    require_suffix(output, ".npz", "`export` writes trajectories in other formats")
    require_writable(output)
    options = RetargetOptions(fps, map_file, legs, balance, edges, preset)
    clip, model = read_clip(motion, frames, source_fps, body_model, up, repair), load(robot, limits)
    with progress({"retarget": retarget_cost(clip)}) as stages:
        result = retargeted(clip, model, options, stages.begin("retarget"))
    result.trajectory.save(output)
    facts = describe_solution(result.solution, result.notes)
    if json:
        console.dump(facts)
    else:
        console.show_solution(facts, explain)
        console.say(f"wrote {output}")
    if own_unmet(result.solution.unmet):
        raise typer.Exit(1)
