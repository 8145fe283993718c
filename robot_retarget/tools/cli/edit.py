"""The group `edit`: new trajectories from trajectories."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from typing import Annotated, Any

import typer

import robot_retarget as rr
from robot_retarget.base.errors import BalanceError, UsageError
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import app, argument, command, option, options
from robot_retarget.tools.cli.console import progress
from robot_retarget.tools.cli.run import require_source, save_judged
from robot_retarget.tools.cli.solve import SolvedOptions

edit: typer.Typer = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Join, loop, splice, retime, mirror, cut, mend trajectories."
)
app.add_typer(edit, name="edit")


@options
class SequenceOptions(SolvedOptions, opt.BalancedOptions, opt.RobotOptions):
    """The robot, its balance, and the trajectory to write."""

    def make(
        self, paths: list[Path], printing: opt.PrintOptions, solve: "Callable[..., rr.Result] | None" = None, **how: Any
    ) -> None:
        """Read trajectories, solve them as one and write it."""

        self.require_writable()
        model = self.load(of=paths[0])
        clips = [rr.load_trajectory(path, model) for path in paths]
        with progress() as begin:
            result = (solve or rr.sequence)(clips, robot=model, balance=self.balance, progress=begin("solve"), **how)
        self.save(result.trajectory, result, printing)


@options
class SeamOptions:
    """Where one trajectory is left and the next one entered, and how fast."""

    best: bool = option("Move each seam to the best frames within a second.", "--best", default=False)
    fade: float | None = option("Duration of a seam [s]; by default as long as the joints need.", default=None)
    speed: float = option("Factor of the speed; the limits of joints and of balance stay.", default=1.0)


@options
class MotionOptions:
    """The trajectory that is altered."""

    trajectory: Path = argument("A motion of the robot, in any format that import reads.")


@command(group=edit, epilog="Example: robot-retarget edit join walk.npz wave.npz --robot op3 -o both.npz")
def join(
    trajectories: Annotated[list[Path], typer.Argument(help="Motions of the robot, in any format that import reads.")],
    to: SequenceOptions,
    seam: SeamOptions,
    printing: opt.PrintOptions,
    at: Annotated[
        list[str] | None,
        typer.Option(
            help="LEAVE:ENTER, per seam: when the clip before is left and the one after entered [s]; by default its end and beginning."
        ),
    ] = None,
) -> None:
    """Solve trajectories in a row as one.

    Each begins where the one before ends. Exit code 2 where two do not fit together.
    """
    to.make(trajectories, printing, at=[_span("--at", text) for text in at or ()], **vars(seam))


@command(
    group=edit, epilog="Example: robot-retarget edit loop walk.npz --robot op3 --times 3 --at 7.5:3 --best -o walks.npz"
)
def loop(
    motion: MotionOptions,
    to: SequenceOptions,
    seam: SeamOptions,
    printing: opt.PrintOptions,
    times: Annotated[int, typer.Option(min=2, help="Number of repetitions.")] = 2,
    at: Annotated[
        str | None, typer.Option(help="LEAVE:ENTER [s] of the repeated part; by default the end and the beginning.")
    ] = None,
) -> None:
    """Repeat a trajectory, or a part of it.

    Each repetition begins where the one before ends.
    """
    spans = [_span("--at", at)] * (times - 1) if at else []
    to.make([motion.trajectory] * times, printing, at=spans, **vars(seam))


@command(group=edit, epilog="Example: robot-retarget edit retime walk.npz --robot op3 --speed 0.8 -o slow.npz")
def retime(
    motion: MotionOptions,
    to: SequenceOptions,
    printing: opt.PrintOptions,
    speed: Annotated[float, typer.Option(help="Factor of the speed; the limits of joints and of balance stay.")],
) -> None:
    """Solve a trajectory at another speed."""
    to.make([motion.trajectory], printing, speed=speed)


@command(
    group=edit, epilog="Example: robot-retarget edit splice --legs squat.npz --arms wave.npz --robot op3 -o both.npz"
)
def splice(
    legs: Annotated[Path, typer.Option(help="The motion of legs, trunk and head, in any format that import reads.")],
    arms: Annotated[Path, typer.Option(help="The motion of the arms.")],
    to: SequenceOptions,
    printing: opt.PrintOptions,
) -> None:
    """Solve the legs of one trajectory with the arms of another."""

    to.make([legs, arms], printing, lambda clips, **how: rr.splice(clips[0], clips[1], **how))


@command(group=edit, epilog="Example: robot-retarget edit stops out/trajectory.npz --robot op3 --every 0.5")
def stops(
    source: opt.TrajectoryOptions,
    robot: opt.RobotOptions,
    on: opt.ServoOptions,
    printing: opt.PrintOptions,
    every: Annotated[float, typer.Option(min=0.1, help="Time between two moments [s].")] = 1.0,
    draws: Annotated[int, typer.Option(min=0, help="Drawn simulations of each way, as in simulate.")] = 10,
) -> None:
    """Solve and judge ways into a stand; `play` takes them on Ctrl-C.

    They begin at moments of a balanced trajectory, and replace the folder stops/ next to it. Exit code 1 if none passes.
    """
    from robot_retarget.base.files import replacing_folder
    from robot_retarget.edit.cuts import ways_into_stand
    from robot_retarget.servo.judgement import FOLDER

    model, played = robot.load(on.servos, source.trajectory), rr.load_trajectory(source.trajectory)
    place, found = source.trajectory.parent / FOLDER, list[dict[str, Any]]()
    with replacing_folder(place) as scratch, progress() as begin:
        begin("ways into a stand")
        for time, outcome in ways_into_stand(played, model, every, draws):
            found.append({"at_s": round(time, 3)} | _saved(outcome, time, scratch / f"{time:.3f}"))
        rmtree(place, ignore_errors=True)
    passed = [row for row in found if row["verdict"] == "pass"]
    failed = [f"{row['at_s']:.2f} s: {'; '.join(row['reasons'])}" for row in found if row not in passed]
    sentence = "\n".join([*failed, f"{len(passed)} of {len(found)} ways pass, in {place}"])
    printing.result({"output": str(place), "passed": len(passed), "ways": found}, sentence)
    if not passed:
        raise typer.Exit(1)


def _saved(outcome: "rr.Report | BalanceError", time: float, folder: Path) -> dict[str, Any]:
    """Write a way into a stand with its report; return its verdict."""
    if isinstance(outcome, BalanceError) or outcome.trajectory is None:
        return {"verdict": "none", "reasons": [str(outcome)]}
    folder.mkdir(parents=True)
    save_judged(outcome, folder / "trajectory.npz", folder / "report.json")
    standing = round(outcome.trajectory.duration - time, 2)
    return {"verdict": outcome.verdict, "reasons": list(outcome.reasons), "standing_after_s": standing}


@command(group=edit, epilog="Example: robot-retarget edit mirror wave.npz --robot op3 -o left.npz")
def mirror(
    source: opt.TrajectoryOptions, robot: opt.RobotOptions, to: opt.OutputOptions, printing: opt.PrintOptions
) -> None:
    """Exchange left and right. The result is not simulated."""
    from robot_retarget.edit.cuts import mirrored

    model = robot.load(of=source.trajectory)
    _write(mirrored(rr.load_trajectory(source.trajectory, model), model), to.output, printing)


@command(group=edit, epilog="Example: robot-retarget edit cut walk.npz --robot op3 --trim 1:3.5 -o part.npz")
def cut(
    source: opt.TrajectoryOptions,
    robot: opt.RobotOptions,
    to: opt.OutputOptions,
    printing: opt.PrintOptions,
    trim: Annotated[str, typer.Option(help="Keep START:STOP [s].")],
) -> None:
    """Keep a part of a trajectory. The result is not simulated."""
    from robot_retarget.edit.cuts import trimmed

    whole = rr.load_trajectory(source.trajectory, robot.load(of=source.trajectory))
    _write(trimmed(whole, *_span("--trim", trim, 0.0, whole.duration)), to.output, printing)


@command(group=edit, epilog="Example: robot-retarget edit keyframes motion_4095.bin#38 --robot op3 -o bye.npz")
def keyframes(
    file: Annotated[str, typer.Argument(help="Keyframes: .json, or FILE.bin#PAGE of ROBOTIS action pages.")],
    robot: opt.RobotOptions,
    on: opt.ServoOptions,
    printing: opt.PrintOptions,
    output: Annotated[
        Path, typer.Option(*opt.OUT, help="The trajectory to write (.npz), or the keyframes in another layout.")
    ],
    fps: Annotated[float, typer.Option(min=1.0, help="Frames per second of the trajectory.")] = 50.0,
) -> None:
    """Make a trajectory of poses with times, least jerk between them. The result is not simulated.

    Where a joint would be too fast, the way to a pose takes longer. `view --keyframes` makes such files.
    """
    from robot_retarget.edit.keyframe_files import keyframe_file
    from robot_retarget.edit.keyframes import trajectory_through

    model = robot.load(on.servos)
    source = keyframe_file(file, model)
    if not source.poses:
        raise UsageError(f"{file} has no keyframes" if source.path.exists() else f"there is no file {source.path}")
    if output.suffix == ".npz":
        made, _ = trajectory_through(source.keyframes, model, fps, source.path.name)
        return _write(made, output, printing, made.notes)
    wrote = keyframe_file(output, model).holding([replace(k, step=None) for k in source.keyframes]).save()
    printing.result({"output": str(wrote), "keyframes": len(source.keyframes)}, f"wrote {wrote}")


def _write(made: "rr.Trajectory", output: Path, printing: opt.PrintOptions, notes: Sequence[str] = ()) -> None:
    from robot_retarget.base.files import require_writable

    require_writable(output)
    made.save(output)
    facts = {"output": str(output), "frames": len(made), "fps": made.fps, "duration_s": round(made.duration, 4)}
    printing.result(facts | {"notes": [*notes]}, "\n".join([*notes, f"wrote {output}, {made.duration:.3g} s"]))


def _span(option: str, text: str, *ends: float) -> tuple[float, float]:
    """Return the two times of A:B [s]; a missing one is that of `ends`."""
    parts = text.split(":")
    try:
        first, second = (
            float(part) if part or not ends else end for part, end in zip(parts, ends or (0, 0), strict=True)
        )
    except ValueError:
        raise UsageError(f"{option} takes two times A:B in seconds, got {text!r}") from None
    return first, second


@options
class MendOptions(opt.ForceOptions, opt.MapOptions, opt.ReadOptions, opt.OutputOptions, opt.TrajectoryOptions):
    """A trajectory, the clip it came from, and its edits."""

    motion: Path = option("The clip it came from.")
    edges: Path = option("EDITS.toml, as the viewer saves it; made in the order they stand.")


@command(
    group=edit,
    epilog="Example: robot-retarget edit mend dance.npz -r op3 --motion dance.bvh --edges EDITS.toml -o mended.npz",
)
def mend(edited: MendOptions, robot: opt.RobotOptions, frozen: opt.FreezeOptions, printing: opt.PrintOptions) -> None:
    """Solve the frames around each edit again, as `view` does. Exit code 1 if a hard edge of the file is not met."""
    from robot_retarget.base.files import require_writable
    from robot_retarget.edit.touchup import apply_edits, graph_of
    from robot_retarget.graph.edits import read_edits
    from robot_retarget.solver.solution import unmet_of_user

    require_writable(edited.output)
    model, edits = frozen.of(robot.load(of=edited.trajectory)), read_edits(edited.edges)
    played, clip = rr.load_trajectory(edited.trajectory, model), edited.read(edited.motion)
    require_source(played, clip, edited.force)
    made, outcomes = apply_edits(graph_of(clip, model, played, edited.map_file), played, edits)
    made.save(edited.output)
    reached = [outcome.reached for outcome in outcomes if outcome.reached]
    unmet = unmet_of_user(edge for outcome in outcomes for edge in outcome.unmet)
    facts = {"output": str(edited.output), "edits": len(edits), "reached": reached, "unmet": unmet}
    wrote = f"wrote {edited.output}; simulate it before you play it"
    printing.result(facts, "\n".join([*reached, *unmet, wrote]))
    if unmet:
        raise typer.Exit(1)
