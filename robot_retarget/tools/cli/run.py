"""`run` and `demo`: everything from a motion to a judged trajectory with its report."""

from pathlib import Path

import typer

from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.command import command, option, options
from robot_retarget.tools.cli.options import (
    OUT,
    ROBOT,
    ClipOptions,
    DefaultRobotOptions,
    GraphOptions,
    PrintOptions,
    ReadOptions,
    ServoOptions,
    load,
)
from robot_retarget.tools.cli.stages import FolderOptions, fill_folder, shipped_clip

commands: typer.Typer = typer.Typer()


@command(commands, epilog="Example: robot-retarget run dance.bvh --robot op3 --out dance")
def run(
    clip: ClipOptions,
    robot: DefaultRobotOptions,
    servos: ServoOptions,
    goals: GraphOptions,
    how: FolderOptions,
    printing: PrintOptions,
) -> None:
    """Retarget, warn, simulate, report: trajectory.npz, report.json, report.html, viewer.html, warnings.csv, strip.png."""
    verdict = fill_folder(clip.load(), robot.load(servos.servos), goals, how, printing)
    raise typer.Exit(0 if verdict == "pass" else 1)


@options
class DemoOptions(FolderOptions):
    """Which shipped clip is shown on which robot."""

    clip: str = option("A shipped clip.", default="wave")
    robot: str = option(f"{ROBOT}.", "--robot", "-r", default="op3")
    out: Path = option("Folder for the results.", *OUT, default=Path("demo"))
    video: bool = option("Make a film as well.", default=True)


@command(commands, epilog="Example: robot-retarget demo --out demo")
def demo(how: DemoOptions, printing: PrintOptions) -> None:
    """Carry a shipped clip over to the OP3-class robot, simulate it, show it, and play it on emulated servos."""
    motion = ReadOptions().read(shipped_clip(how.clip))
    verdict = fill_folder(motion, load(how.robot), GraphOptions(), how, printing, play=True)
    if verdict != "pass" and not printing.json:
        console.say("not played: the verdict is fail")
