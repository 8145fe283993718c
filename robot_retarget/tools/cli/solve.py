"""`solve`, `transfer`: a motion, or that of another robot, to a trajectory."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

import robot_retarget as rr
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.console import progress
from robot_retarget.tools.cli.formats import KnownOptions


@options
class SolvedOptions(opt.OutputOptions):
    """The trajectory to write."""

    def require_writable(self) -> None:
        """Refuse a file that cannot be written."""
        from robot_retarget.base.files import require_suffix, require_writable

        require_suffix(self.output, ".npz", "`export` writes trajectories in other formats")
        require_writable(self.output)

    def of(self, performer: str) -> "SolvedOptions":
        """Return the output of one of several performers, `OUTPUT_NAME.npz`; of the only one with an empty name."""
        stem, name = self.output.stem, re.sub(r"[^\w.-]+", "_", performer)
        return replace(self, output=self.output.with_name(f"{stem}_{name}.npz")) if performer else self

    def save(self, trajectory: "rr.Trajectory", result: "rr.Result", printing: opt.PrintOptions) -> None:
        """Write a trajectory and show how it was solved."""
        from robot_retarget.tools.summary import describe_solution

        trajectory.save(self.output)
        printing.show(describe_solution(result.solution, result.notes), self._show)

    def _show(self, facts: dict[str, Any]) -> None:
        console.show_solution(facts)
        console.say(f"wrote {self.output}")


@command(epilog="Example: robot-retarget solve dance.bvh --robot op3 -o dance.npz")
def solve(
    clip: opt.PerformerOptions,
    to: SolvedOptions,
    robot: opt.DefaultRobotOptions,
    goals: opt.EditedGraphOptions,
    following: opt.FollowOptions,
    ends: opt.StandOptions,
    printing: opt.PrintOptions,
) -> None:
    """Retarget a motion: the trajectory only. Exit code 1 if a hard edge of --edges is not met."""
    from robot_retarget.edit.stands import between_stands
    from robot_retarget.solver.solution import unmet_of_user

    to.require_writable()
    model, unmet = robot.load(), False
    for name, performer in clip.performers().items():
        motion = performer.load()
        with progress() as begin:
            result = opt.solved(goals.describe(motion, model), following, begin("retarget"))
        to.of(name).save(between_stands(result.trajectory, model, ends.stand), result, printing)
        unmet |= bool(unmet_of_user(result.solution.unmet))
    if unmet:
        raise typer.Exit(1)


@options
class TransferOptions(KnownOptions):
    """The motion of a robot, and the robot that follows."""

    motion: Path = argument("The motion of a robot, in any format that import reads.")
    source: str = option(
        "The robot that performs it: a name or a model file; by default the one that the file names.",
        "--from",
        "-f",
        default="",
    )
    robot: str = option("The robot that follows: a name or a model file.", "--to", "-t", default="")
    source_fps: float | None = option("Frames per second of the motion file; overrides the stored rate.", default=None)


@command(epilog="Example: robot-retarget transfer dance_g1.npz --from g1 --to op3 -o dance_op3.npz")
def transfer(
    performed: TransferOptions,
    to: SolvedOptions,
    rate: opt.RateOptions,
    frozen: opt.FreezeOptions,
    limits: opt.LimitOptions,
    following: opt.FollowOptions,
    printing: opt.PrintOptions,
) -> None:
    """Carry the motion of one robot over to another."""
    from robot_retarget.formats import FormatOptions, import_motion

    to.require_writable()
    performer = opt.load(performed.source) if performed.source else opt.load_of(performed.motion)
    follower = frozen.of(opt.load(opt.named_robot(performed.robot), limits.limits))
    read = FormatOptions(source_fps=performed.source_fps)
    trajectory = import_motion(performed.motion, performer, performed.format, read)
    legs, balance = following.legs, following.balance
    with progress() as begin:
        bar, what = begin("transfer"), (trajectory, performer, follower)
        result = rr.transfer(*what, fps=rate.fps, preset=rate.preset, legs=legs, balance=balance, progress=bar)
    to.save(result.trajectory, result, printing)


# `graph`: the edges of a motion on a robot.


@command(epilog="Example: robot-retarget graph dance.bvh --robot op3 --solve")
def graph(
    clip: opt.ClipOptions,
    robot: opt.DefaultRobotOptions,
    goals: opt.EditedGraphOptions,
    printing: opt.PrintOptions,
    solve: Annotated[bool, typer.Option(help="Solve it too: stress per kind, and the edges that lost most.")] = False,
) -> None:
    """Show the edges of a motion on a robot.

    Kinds, counts, intervals, priorities, stress.
    """
    from robot_retarget.tools.summary import describe_graph, describe_stress

    found = goals.describe(clip.load(), robot.load())
    facts: dict[str, Any] = describe_graph(found)
    if solve:
        with progress() as begin:
            facts |= describe_stress(rr.solve(found, balance="off", progress=begin("retarget")).solution)
    printing.show(facts, console.show_graph)
