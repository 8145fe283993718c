"""`export`: a trajectory in a format that others read."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Limits, RobotName, TrajectoryFile
from robot_retarget.cli.stages import load

commands = typer.Typer()


@commands.command(epilog="Example: robot-retarget export dance.npz --robot op3 --format csv -o dance.csv")
def export(
    trajectory: TrajectoryFile,
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write.")],
    format: Annotated[str, typer.Option("--format", "-f", help="csv or unitree.")] = "csv",
    limits: Limits = None,
) -> None:
    """Write a trajectory in a format that others read."""
    from robot_retarget.export import export as write
    from robot_retarget.trajectory import load_trajectory

    write(load_trajectory(trajectory), load(robot, limits), format, output)
    console.say(f"wrote {output}")
