"""`join`, `loop`, `splice`, `retime`, `mirror`, `cut`: trajectories made of trajectories."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robot_retarget.cli import console
from robot_retarget.cli.bars import progress
from robot_retarget.cli.options import Balance, Json, Limits, Quiet, RobotName, TrajectoryFile
from robot_retarget.cli.solve import Explain, save_solved
from robot_retarget.cli.stages import load
from robot_retarget.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_retarget.result import Result
    from robot_retarget.trajectory import Trajectory

commands: typer.Typer = typer.Typer()
Output = Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")]
At = Annotated[
    list[str] | None,
    typer.Option(
        help="LEAVE:ENTER, per seam: when the clip before is left and the one after entered [s]; by default its end and beginning."
    ),
]
Best = Annotated[bool, typer.Option("--best", help="Move each seam to the best frames within a second.")]
Fade = Annotated[float | None, typer.Option(help="Duration of a seam [s]; by default what the joints need.")]


@commands.command(epilog="Example: robot-retarget join walk.npz wave.npz --robot op3 -o both.npz")
def join(
    trajectories: Annotated[list[Path], typer.Argument(help="Motions of the robot, in any format that import reads.")],
    robot: RobotName,
    output: Output,
    at: At = None,
    best: Best = False,
    fade: Fade = None,
    balance: Balance = "auto",
    limits: Limits = None,
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Solve trajectories in a row; each begins where the one before ends. Exit code 2 where two do not fit together."""
    spans = [_span("--at", text) for text in at or ()]
    _made(
        trajectories,
        robot,
        limits,
        output,
        explain,
        json,
        {"at": spans, "best": best, "fade": fade, "balance": balance},
    )


@commands.command(epilog="Example: robot-retarget loop walk.npz --robot op3 --times 3 --at 7.5:3 --best -o walks.npz")
def loop(
    trajectory: Annotated[Path, typer.Argument(help="A motion of the robot, in any format that import reads.")],
    robot: RobotName,
    output: Output,
    times: Annotated[int, typer.Option(min=2, help="Number of repetitions.")] = 2,
    at: Annotated[
        str | None, typer.Option(help="LEAVE:ENTER [s] of the repeated part; by default the end and the beginning.")
    ] = None,
    best: Best = False,
    fade: Fade = None,
    balance: Balance = "auto",
    limits: Limits = None,
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Repeat a trajectory, or a part of it; each repetition begins where the one before ends."""
    spans = [_span("--at", at)] * (times - 1) if at else []
    options = {"at": spans, "best": best, "fade": fade, "balance": balance}
    _made([trajectory] * times, robot, limits, output, explain, json, options)


@commands.command(epilog="Example: robot-retarget retime walk.npz --robot op3 --speed 0.8 -o slow.npz")
def retime(
    trajectory: Annotated[Path, typer.Argument(help="A motion of the robot, in any format that import reads.")],
    robot: RobotName,
    output: Output,
    speed: Annotated[float, typer.Option(help="Factor of the speed; the limits of joints and of balance stay.")],
    balance: Balance = "auto",
    limits: Limits = None,
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Solve a trajectory at another speed."""
    _made([trajectory], robot, limits, output, explain, json, {"speed": speed, "balance": balance})


@commands.command(epilog="Example: robot-retarget splice --legs squat.npz --arms wave.npz --robot op3 -o both.npz")
def splice(
    legs: Annotated[Path, typer.Option(help="The motion of legs, trunk and head, in any format that import reads.")],
    arms: Annotated[Path, typer.Option(help="The motion of the arms.")],
    robot: RobotName,
    output: Output,
    balance: Balance = "auto",
    limits: Limits = None,
    explain: Explain = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Solve the legs of one trajectory with the arms of another."""
    from robot_retarget.sequence.build import splice as spliced

    def solved(clips: "list[Trajectory]", **options: Any) -> "Result":
        return spliced(clips[0], clips[1], **options)

    _made([legs, arms], robot, limits, output, explain, json, {"balance": balance}, solved)


def _made(
    paths: list[Path],
    robot: str,
    limits: Path | None,
    output: Path,
    explain: bool,
    json: bool,
    options: dict[str, Any],
    solve: "Callable[..., Result] | None" = None,
) -> None:
    """Read trajectories, solve them as one and write it."""
    from robot_retarget.files import require_suffix, require_writable
    from robot_retarget.formats import load_trajectory
    from robot_retarget.sequence.build import sequence

    require_suffix(output, ".npz", "`export` writes trajectories in other formats")
    require_writable(output)
    model = load(robot, limits)
    clips = [load_trajectory(path, model) for path in paths]
    with progress({"solve": 0.5 + 0.5 * sum(clip.duration for clip in clips)}) as stages:
        result = (solve or sequence)(clips, robot=model, progress=stages.begin("solve"), **options)
    save_solved(result, output, explain, json)


@commands.command(epilog="Example: robot-retarget mirror wave.npz --robot op3 -o left.npz")
def mirror(
    trajectory: TrajectoryFile,
    robot: RobotName,
    output: Output,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Exchange left and right. The result is not simulated."""
    from robot_retarget.edit import mirrored
    from robot_retarget.formats import load_trajectory

    model = load(robot, limits)
    _write(mirrored(load_trajectory(trajectory, model), model), output, json)


@commands.command(epilog="Example: robot-retarget cut walk.npz --robot op3 --trim 1:3.5 -o part.npz")
def cut(
    trajectory: TrajectoryFile,
    robot: RobotName,
    output: Output,
    trim: Annotated[str, typer.Option(help="Keep START:STOP [s].")],
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Keep a part of a trajectory. The result is not simulated."""
    from robot_retarget.edit import trimmed
    from robot_retarget.formats import load_trajectory

    whole = load_trajectory(trajectory, load(robot, limits))
    _write(trimmed(whole, *_span("--trim", trim, 0.0, whole.duration)), output, json)


def _write(made: "Trajectory", output: Path, json: bool) -> None:
    from robot_retarget.files import require_writable

    require_writable(output)
    made.save(output)
    facts = {"output": str(output), "frames": len(made), "fps": made.fps, "duration_s": round(made.duration, 4)}
    console.show_result(facts, f"wrote {output}, {made.duration:.3g} s", json)


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
