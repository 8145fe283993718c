"""`play`: a trajectory on Dynamixel servos."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Baud, Json, Port, Quiet, TrajectoryFile
from robot_retarget.cli.stages import judged_plain, load
from robot_retarget.errors import UsageError

if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.servo.outcome import PlaybackOutcome
    from robot_retarget.servo.plan import ServoPlan
    from robot_retarget.trajectory import Trajectory

commands: typer.Typer = typer.Typer()

OPEN_LOOP = (
    "the goals passed with feedback: simulate --no-feedback judges them without it, and --unsafe sends them unjudged"
)
ALTERED = "--rate, --speed, --loop, --from and --to alter the judged motion: add --plain, which simulates the altered one first, or --unsafe"


@commands.command(epilog="Example: robot-retarget play out/trajectory.npz --servos op3 --port /dev/ttyUSB0")
def play(
    trajectory: TrajectoryFile,
    servos: Annotated[str, typer.Option("--servos", "-s", help="A shipped robot's name (op3) or a servo map (.toml).")],
    port: Port = "",
    report: Annotated[
        Path | None, typer.Option(help="Report of the trajectory; by default the one in its folder.")
    ] = None,
    loose: Annotated[
        bool, typer.Option("--loose-thresholds", help="Accept a pass under thresholds above the defaults.")
    ] = False,
    feedback: Annotated[bool, typer.Option(help="Play the balance feedback of goals that were judged with it.")] = True,
    plain: Annotated[
        bool, typer.Option("--plain", help="Simulate the plain trajectory, and send it if it passes.")
    ] = False,
    unsafe: Annotated[bool, typer.Option("--unsafe", help="Play without a passing report.")] = False,
    robot: Annotated[
        str | None,
        typer.Option("--robot", "-r", help="With --plain: the robot to simulate; by default the trajectory's."),
    ] = None,
    mode: Annotated[
        Literal["free", "pinned"], typer.Option(help="free (on a floor), or pinned: the robot is held by its pelvis.")
    ] = "free",
    rate: Annotated[
        float | None, typer.Option(min=10, max=1000, help="With --plain or --unsafe: ticks a second, 125 by default.")
    ] = None,
    speed: Annotated[float, typer.Option(help="With --plain or --unsafe: factor of the trajectory's speed.")] = 1.0,
    loop: Annotated[int, typer.Option(help="With --plain or --unsafe: number of repetitions.")] = 1,
    start: Annotated[float, typer.Option("--from", help="With --plain or --unsafe: begin here [s].")] = 0.0,
    stop: Annotated[float | None, typer.Option("--to", help="With --plain or --unsafe: end here [s].")] = None,
    baud: Baud = None,
    log: Annotated[Path, typer.Option(help="The log to write (.npz).")] = Path("play.npz"),
    end_pose: Annotated[bool, typer.Option(help="Go to the map's stop pose at the end.")] = True,
    release: Annotated[bool, typer.Option("--release", help="Switch torque off at the end.")] = False,
    test_lean: Annotated[
        bool,
        typer.Option(help="With feedback: lean 3° right and ahead first, and compare the inertial sensor with that."),
    ] = True,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Start the test lean without a question.")] = False,
    grace: Annotated[
        float, typer.Option(help="After Ctrl-C: time to hold the pose; a second Ctrl-C switches torque off [s].")
    ] = 10.0,
    wait: Annotated[float, typer.Option(min=0, help="Longest wait for a missing port [s].")] = 5.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check everything, move nothing.")] = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Send the goals of a trajectory that passed to Dynamixel servos. Exit code 1 when it was stopped."""
    from robot_retarget.actuators.map import load_map
    from robot_retarget.files import require_writable
    from robot_retarget.servo.judgement import require_judged
    from robot_retarget.servo.outcome import PlaybackOptions
    from robot_retarget.servo.plan import goal_plan
    from robot_retarget.servo.play import play as perform
    from robot_retarget.servo.play import preview
    from robot_retarget.trajectory import load_trajectory

    options, servo_map = PlaybackOptions(end_pose, release, grace=grace, test_lean=test_lean), load_map(servos)
    servo_map = replace(servo_map, baud=baud) if baud else servo_map
    read, part = load_trajectory(trajectory), PlaybackRange(speed, loop, start, stop)
    if plain:
        plan = _plain(read, part, servo_map, servos, robot, mode, rate, feedback)
    elif unsafe:
        plan = _unjudged(read, part, servo_map, rate)
    else:
        if part != PlaybackRange() or rate is not None:
            raise UsageError(ALTERED)
        options = replace(
            options, tracking_rms=require_judged(trajectory, read, servo_map, servos, report, mode, loose)
        )
        plan = goal_plan(read, servo_map)
        if plan.feedback is not None and not feedback:
            raise UsageError(OPEN_LOOP)
    if not feedback:
        plan = replace(plan, feedback=None)
    if mode == "pinned":
        plan = plan.held()
    if dry_run:
        facts = preview(plan, servo_map, port or None)
        console.dump(facts) if json else console.table("Dry run", ("figure", "value"), [*facts.items()])
        return
    if not port:
        raise UsageError("play needs --port (or --dry-run)")
    require_writable(log)
    if plan.feedback is not None and test_lean and not yes:
        _agree()
    _await(Path(port), wait)
    say = (lambda text: None) if json else console.say
    outcome = perform(plan, servo_map, port, options, log, say)
    _tell(outcome, log, json)
    raise typer.Exit(outcome.exit_code)


def _agree() -> None:
    """Ask at a terminal whether the robot may lean."""
    question = "To test its inertial sensor, the robot leans 3° right and ahead first. Does it stand free on a floor?"
    if sys.stdin.isatty() and not typer.confirm(question):
        raise UsageError("not confirmed: --no-test-lean leaves the test out")


def _await(port: Path, wait: float) -> None:
    """Wait until a port exists, for example that of a starting emulator; opening a missing port reports it."""
    end = monotonic() + wait
    if not port.exists() and wait > 0:
        console.to_stderr(f"waiting up to {wait:g} s for {port}")
    while not port.exists() and monotonic() < end:
        sleep(0.05)


@dataclass(frozen=True)
class PlaybackRange:
    """Which part of a trajectory, how fast and how often."""

    speed: float = 1.0
    loops: int = 1
    start: float = 0.0
    stop: float | None = None

    def of(self, trajectory: "Trajectory") -> "Trajectory":
        from robot_retarget.servo.plan import part_of

        return part_of(trajectory, self.speed, self.loops, self.start, self.stop)


def _plain(
    trajectory: "Trajectory",
    part: PlaybackRange,
    servo_map: "ServoMap",
    servos: str,
    robot: str | None,
    mode: str,
    rate: float | None,
    feedback: bool,
) -> "ServoPlan":
    """Return the goals of the plain trajectory after it passes in simulation, with feedback where the map has a sensor."""
    from robot_retarget.goals import RATE
    from robot_retarget.servo.plan import goal_plan

    model = load(robot or trajectory.robot, None, servos)
    how = None if feedback else False
    return goal_plan(judged_plain(part.of(trajectory), model, mode, rate or RATE, how), servo_map)


def _unjudged(trajectory: "Trajectory", part: PlaybackRange, servo_map: "ServoMap", rate: float | None) -> "ServoPlan":
    """Return the stored goals if nothing is altered, else the plain trajectory."""
    from robot_retarget.goals import RATE
    from robot_retarget.servo.plan import goal_plan, plain_plan

    if trajectory.goals is not None and part == PlaybackRange() and rate is None:
        return goal_plan(trajectory, servo_map)
    return plain_plan(part.of(trajectory), servo_map, rate or RATE)


def _tell(outcome: "PlaybackOutcome", log: Path, json: bool) -> None:
    """Print how a playback ended."""
    if json:
        facts = {"ended": outcome.ended.name.lower(), "state": outcome.state, "reason": outcome.reason}
        console.dump(facts | {"figures": outcome.figures, "warnings": list(outcome.warnings), "log": str(log)})
        return
    for sentence in outcome.warnings:
        console.note(sentence)
    console.show_playback(outcome.figures)
    console.say(f"{outcome.sentence}; log in {log}")
