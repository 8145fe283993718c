"""`info`: describe a motion or a robot."""

from pathlib import Path

import typer

from robot_retarget.base.errors import UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.options import DEFAULT_ROBOT, LimitOptions, PrintOptions, ReadOptions, load
from robot_retarget.tools.cli.stages import is_robot_name

commands: typer.Typer = typer.Typer()


@options
class InfoOptions:
    """The object to describe."""

    file: str | None = argument("A motion, an MJCF file or a robot's name.", default=None)
    robot: str | None = option("A robot, where its name is also a file's.", "--robot", "-r", default=None)
    scene: Path | None = option(
        "Bodies around the human: a TOML of shapes, or an MJCF or URDF (docs/scenes.md).", "--scene", default=None
    )


@command(commands, epilog="Example: robot-retarget info dance.bvh")
def info(subject: InfoOptions, reading: ReadOptions, limits: LimitOptions, printing: PrintOptions) -> None:
    """Describe a motion or a robot, its recognised keypoints, and the bodies of a scene with the parts that touch them."""
    from robot_retarget.scene import read_scene
    from robot_retarget.tools.summary import describe_motion, describe_robot, describe_scene, describe_terrain

    file, robot = str(subject.file), subject.robot
    if (subject.file is None) == (robot is None):
        raise UsageError("info takes one thing: a motion, an MJCF file, or --robot NAME")
    if robot is not None or is_robot_name(file):
        facts = describe_robot(load(robot or file, limits.limits))
    else:
        motion = reading.read(Path(file))
        facts = describe_motion(motion)
        if subject.scene is not None:
            facts |= describe_scene(motion.with_scene(read_scene(subject.scene)), load(DEFAULT_ROBOT))
        elif facts["human"]:
            facts |= describe_terrain(motion, load(DEFAULT_ROBOT))
    printing.show(facts, console.show_robot if facts["kind"] == "robot" else console.show_motion)
    if not facts.get("human", facts.get("humanoid", True)):
        raise typer.Exit(2)
