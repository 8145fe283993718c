"""`solve`, `transfer`: a motion, or that of another robot, to a trajectory."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.bars import progress
from robot_retarget.cli.formats import FileFormat
from robot_retarget.cli.options import (
    Balance,
    BodyModel,
    DefaultRobot,
    Edges,
    Fps,
    Frames,
    Freeze,
    Height,
    Json,
    Legs,
    Limits,
    MotionFile,
    Only,
    Overrides,
    Preset,
    Quiet,
    Repair,
    SceneFile,
    SceneScale,
    SourceFps,
    Up,
    named_robot,
)
from robot_retarget.cli.stages import RetargetOptions, load, own_unmet, read_clip, retarget_cost, retargeted

if TYPE_CHECKING:
    from robot_retarget.result import Result

commands: typer.Typer = typer.Typer()
Explain = Annotated[bool, typer.Option(help="Print the edges that lost most.")]


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
    height: Height = None,
    map_file: Overrides = None,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    edges: Edges = None,
    scene: SceneFile = None,
    scene_scale: SceneScale = "human",
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Retarget a motion: the trajectory only. Exit code 1 if a hard edge of --edges is not met."""
    from robot_retarget.files import require_suffix, require_writable

    require_suffix(output, ".npz", "`export` writes trajectories in other formats")
    require_writable(output)
    options = RetargetOptions(fps, map_file, legs, balance, edges, preset, scene, scene_scale)
    clip = read_clip(motion, frames, source_fps, body_model, up, repair, height)
    model = load(robot, limits, None, freeze, only)
    with progress({"retarget": retarget_cost(clip)}) as stages:
        result = retargeted(clip, model, options, stages.begin("retarget"))
    save_solved(result, output, explain, json)
    if own_unmet(result.solution.unmet):
        raise typer.Exit(1)


@commands.command(epilog="Example: robot-retarget transfer dance_g1.npz --from g1 --to op3 -o dance_op3.npz")
def transfer(
    motion: Annotated[Path, typer.Argument(help="The motion of a robot, in any format that import reads.")],
    source: Annotated[str, typer.Option("--from", "-f", help="The robot that performs it: a name or a model file.")],
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")],
    robot: Annotated[str, typer.Option("--to", "-t", help="The robot that follows: a name or a model file.")] = "",
    format: FileFormat = None,
    source_fps: SourceFps = None,
    fps: Fps = None,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    preset: Preset = "balanced",
    legs: Legs = "auto",
    balance: Balance = "auto",
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Carry the motion of one robot over to another."""
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.formats import FormatOptions, import_motion
    from robot_retarget.pipeline import transfer as carried

    require_suffix(output, ".npz", "`export` writes trajectories in other formats")
    require_writable(output)
    performer, follower = load(source, None), load(named_robot(robot), limits, None, freeze, only)
    trajectory = import_motion(motion, performer, format, FormatOptions(source_fps=source_fps))
    with progress({"transfer": 0.5 + 0.5 * trajectory.duration}) as stages:
        begun = stages.begin("transfer")
        result = carried(
            trajectory, performer, follower, fps=fps, preset=preset, legs=legs, balance=balance, progress=begun
        )
    save_solved(result, output, explain, json)


def save_solved(result: "Result", output: Path, explain: bool, json: bool) -> None:
    """Write the trajectory and show how it was solved."""
    from robot_retarget.summary import describe_solution

    result.trajectory.save(output)
    facts = describe_solution(result.solution, result.notes)
    if json:
        console.dump(facts)
    else:
        console.show_solution(facts, explain)
        console.say(f"wrote {output}")
