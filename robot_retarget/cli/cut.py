"""`cut`: a part of a trajectory, its mirror image, several in a row."""

from pathlib import Path
from typing import Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Json, Limits, Quiet, RobotName
from robot_retarget.cli.stages import load
from robot_retarget.errors import UsageError

commands: typer.Typer = typer.Typer()


@commands.command(epilog="Example: robot-retarget cut walk.npz --robot op3 --trim 1:3.5 --repeat 3 -o walks.npz")
def cut(
    trajectories: Annotated[list[Path], typer.Argument(help="Trajectories .npz, joined in this order.")],
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The trajectory to write (.npz).")],
    trim: Annotated[str | None, typer.Option(help="Keep START:STOP of each [s].")] = None,
    mirror: Annotated[bool, typer.Option("--mirror", help="Left for right.")] = False,
    repeat: Annotated[int, typer.Option(help="Number of repetitions.")] = 1,
    seam: Annotated[float, typer.Option(help="Time over which the difference at a seam fades [s].")] = 0.4,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Trim, mirror, join and repeat trajectories; seams are smooth. The result is not simulated."""
    from robot_retarget import edit
    from robot_retarget.files import require_writable
    from robot_retarget.formats import load_trajectory

    require_writable(output)
    model = load(robot, limits)
    parts = [load_trajectory(path, model) for path in trajectories]
    if trim is not None:
        parts = [edit.trimmed(part, *_span(trim, part.duration)) for part in parts]
    if mirror:
        parts = [edit.mirrored(part, model) for part in parts]
    made = parts[0] if len(parts) == 1 else edit.joined(parts, model, seam)
    made = made if repeat == 1 else edit.repeated(made, model, repeat, seam)
    made.save(output)
    facts = {"output": str(output), "frames": len(made), "fps": made.fps, "duration_s": round(made.duration, 4)}
    console.show_result(facts, f"wrote {output}, {made.duration:.3g} s", json)


def _span(text: str, duration: float) -> tuple[float, float]:
    start, colon, stop = text.partition(":")
    try:
        if not colon:
            raise ValueError
        return float(start or 0), float(stop) if stop else duration
    except ValueError:
        raise UsageError(f"--trim takes START:STOP in seconds, got {text!r}") from None
