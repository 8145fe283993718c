"""`graph`: the edges of a motion on a robot."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from robot_retarget.cli import console
from robot_retarget.cli.bars import progress
from robot_retarget.cli.options import (
    DefaultRobot,
    Edges,
    Fps,
    Frames,
    Freeze,
    Json,
    Limits,
    MotionFile,
    Only,
    Overrides,
    Preset,
    Quiet,
    SceneFile,
    SceneScale,
    Up,
)
from robot_retarget.cli.stages import described, load, read_clip, retarget_cost

if TYPE_CHECKING:
    pass

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget graph dance.bvh --robot op3 --solve")
def graph(
    motion: MotionFile,
    robot: DefaultRobot = "",
    frames: Frames = None,
    up: Up = None,
    fps: Fps = None,
    map_file: Overrides = None,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    edges: Edges = None,
    preset: Preset = "balanced",
    scene: SceneFile = None,
    scene_scale: SceneScale = "human",
    solve: Annotated[bool, typer.Option(help="Solve it too: stress per kind, and the edges that lost most.")] = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Show the edges of a motion on a robot: kinds, counts, intervals, priorities, stress."""
    from robot_retarget.pipeline import solve as solved
    from robot_retarget.summary import describe_graph, describe_stress

    clip = read_clip(motion, frames, up=up)
    found = described(clip, load(robot, limits, None, freeze, only), fps, map_file, edges, preset, scene, scene_scale)
    facts: dict[str, Any] = describe_graph(found)
    if solve:
        with progress({"retarget": retarget_cost(clip)}) as stages:
            facts |= describe_stress(solved(found, balance="off", progress=stages.begin("retarget")).solution)
    if json:
        console.dump(facts)
    else:
        console.show_graph(facts)
