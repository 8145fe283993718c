"""`play`: a trajectory on Dynamixel servos."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Baud, Json, Port, TrajectoryFile
from robot_retarget.errors import UsageError

if TYPE_CHECKING:
    from robot_retarget.servo.outcome import Outcome

commands = typer.Typer()


@commands.command(epilog="Example: robot-retarget play dance.npz --servos op3 --port /dev/ttyUSB0")
def play(
    trajectory: TrajectoryFile,
    servos: Annotated[str, typer.Option("--servos", "-s", help="A shipped robot's name (op3) or a servo map (.toml).")],
    port: Port = "",
    report: Annotated[Path | None, typer.Option(help="report.json of the trajectory; beside it by default.")] = None,
    unsafe: Annotated[bool, typer.Option("--unsafe", help="Play without a passing report.")] = False,
    rate: Annotated[float, typer.Option(min=10, max=1000, help="Ticks a second.")] = 100.0,
    speed: Annotated[float, typer.Option(help="Times the trajectory's own speed.")] = 1.0,
    loop: Annotated[int, typer.Option(help="So many times over.")] = 1,
    start: Annotated[float, typer.Option("--from", help="Begin here [s].")] = 0.0,
    stop: Annotated[float | None, typer.Option("--to", help="End here [s].")] = None,
    baud: Baud = None,
    log: Annotated[Path, typer.Option(help="The log to write (.npz).")] = Path("play.npz"),
    end_pose: Annotated[bool, typer.Option(help="Go to the map's stop pose at the end.")] = True,
    release: Annotated[bool, typer.Option("--release", help="Switch torque off at the end.")] = False,
    grace: Annotated[
        float, typer.Option(help="After Ctrl-C: hold so long for a second one, which lets go [s].")
    ] = 10.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check everything, move nothing.")] = False,
    json: Json = False,
) -> None:
    """Play a trajectory that passed on Dynamixel servos. Exit code 1 when it was stopped."""
    from dataclasses import replace

    from robot_retarget.files import require_writable
    from robot_retarget.servo.map import load_map
    from robot_retarget.servo.outcome import Options
    from robot_retarget.servo.plan import make_plan, require_pass
    from robot_retarget.servo.play import play as perform
    from robot_retarget.servo.play import rehearse
    from robot_retarget.trajectory import load_trajectory

    servo_map = load_map(servos)
    servo_map = replace(servo_map, baud=baud) if baud else servo_map
    plan = make_plan(load_trajectory(trajectory), servo_map, speed, loop, start, stop)
    if not unsafe and not require_pass(trajectory, report):
        console.note(
            "the report is of goals that make up for lag and load; the trajectory is played as it is, "
            "which simulate --no-compensate judges"
        )
    if dry_run:
        facts = rehearse(plan, servo_map, port or None)
        console.dump(facts) if json else console.table("Dry run", ("figure", "value"), [*facts.items()])
        return
    if not port:
        raise UsageError("play needs --port (or --dry-run)")
    require_writable(log)
    say = (lambda text: None) if json else console.say
    outcome = perform(plan, servo_map, port, Options(rate, end_pose, release, grace=grace), log, say)
    _tell(outcome, log, json)
    raise typer.Exit(outcome.exit_code)


def _tell(outcome: "Outcome", log: Path, json: bool) -> None:
    """How a playback ended."""
    if json:
        facts = {"ended": outcome.ended.name.lower(), "state": outcome.state, "reason": outcome.reason}
        console.dump(facts | {"figures": outcome.figures, "warnings": list(outcome.warnings), "log": str(log)})
        return
    for sentence in outcome.warnings:
        console.note(sentence)
    console.table("Played", ("figure", "value"), [(k, str(v)) for k, v in outcome.figures.items()])
    console.say(f"{outcome.sentence}; log in {log}")
