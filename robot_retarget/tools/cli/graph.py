"""`graph`: the edges of a motion on a robot."""

from typing import Annotated, Any

import typer

from robot_retarget.tools.cli import console
from robot_retarget.tools.cli.bars import progress
from robot_retarget.tools.cli.command import command
from robot_retarget.tools.cli.options import ClipOptions, DefaultRobotOptions, EditedGraphOptions, PrintOptions

commands: typer.Typer = typer.Typer()


@command(commands, epilog="Example: robot-retarget graph dance.bvh --robot op3 --solve")
def graph(
    clip: ClipOptions,
    robot: DefaultRobotOptions,
    goals: EditedGraphOptions,
    printing: PrintOptions,
    solve: Annotated[bool, typer.Option(help="Solve it too: stress per kind, and the edges that lost most.")] = False,
) -> None:
    """Show the edges of a motion on a robot: kinds, counts, intervals, priorities, stress."""
    from robot_retarget.solver.pipeline import solve as solved
    from robot_retarget.tools.summary import describe_graph, describe_stress

    found = goals.describe(clip.load(), robot.load())
    facts: dict[str, Any] = describe_graph(found)
    if solve:
        with progress() as begin:
            facts |= describe_stress(solved(found, balance="off", progress=begin("retarget")).solution)
    printing.show(facts, console.show_graph)
