"""`info`: describe a motion or a robot."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import BodyModel, Json, Limits, Quiet, Repair, SourceFps, Up
from robot_retarget.cli.stages import is_robot_name, load, read_clip
from robot_retarget.errors import UsageError

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget info dance.bvh")
def info(
    file: Annotated[str | None, typer.Argument(help="A motion, an MJCF file or a robot's name.")] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", "-r", help="A robot, where its name is also a file's.")
    ] = None,
    source_fps: SourceFps = None,
    body_model: BodyModel = None,
    up: Up = None,
    repair: Repair = True,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Describe a motion or a robot, and its recognised keypoints."""
    from robot_retarget.summary import describe_motion, describe_robot

    if (file is None) == (robot is None):
        raise UsageError("info takes one thing: a motion, an MJCF file, or --robot NAME")
    if robot is not None or is_robot_name(str(file)):
        facts = describe_robot(load(str(robot or file), limits))
    else:
        facts = describe_motion(read_clip(Path(str(file)), None, source_fps, body_model, up, repair))
    if json:
        console.dump(facts)
    elif facts["kind"] == "robot":
        console.show_robot(facts)
    else:
        console.show_motion(facts)
    if not facts.get("human", facts.get("humanoid", True)):
        raise typer.Exit(2)
