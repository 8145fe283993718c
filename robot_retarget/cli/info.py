"""`info`: describe a motion or a robot."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import DEFAULT_ROBOT, BodyModel, Json, Limits, Quiet, Repair, SceneFile, SourceFps, Up
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
    scene: SceneFile = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Describe a motion or a robot, its recognised keypoints, and the bodies of a scene with the parts that touch them."""
    from robot_retarget.scene import read_scene
    from robot_retarget.summary import describe_motion, describe_robot, describe_scene

    if (file is None) == (robot is None):
        raise UsageError("info takes one thing: a motion, an MJCF file, or --robot NAME")
    if robot is not None or is_robot_name(str(file)):
        facts = describe_robot(load(str(robot or file), limits))
    else:
        motion = read_clip(Path(str(file)), None, source_fps, body_model, up, repair)
        facts = describe_motion(motion)
        if scene is not None:
            facts |= describe_scene(motion.with_scene(read_scene(scene)), load(DEFAULT_ROBOT, None))
    if json:
        console.dump(facts)
    elif facts["kind"] == "robot":
        console.show_robot(facts)
    else:
        console.show_motion(facts)
    if not facts.get("human", facts.get("humanoid", True)):
        raise typer.Exit(2)
