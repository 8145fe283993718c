"""`play`: a trajectory on Dynamixel servos."""

import sys
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Literal

import typer

import robot_retarget as rr
from robot_retarget.base.errors import UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.run import judged_plain

if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.servo.judgement import Piece
    from robot_retarget.servo.outcome import PlaybackOutcome
    from robot_retarget.servo.plan import ServoPlan


OPEN_LOOP = (
    "the goals passed with feedback: simulate --no-feedback judges them without it, and --unsafe sends them unjudged"
)
ALTERED = (
    "--speed and --freeze alter the judged motion: add --plain, which simulates the altered one first, or --unsafe"
)


@options
class PlayOptions(opt.BaudOptions):
    """Options of a playback: trajectory, servos and checks."""

    trajectory: Path = argument(
        "rr.Trajectory .npz, as simulate judged it, or a playlist .toml of such.", callback=opt.taking("playable")
    )
    servos: str = option("A shipped robot's name (op3) or a servo map (.toml).", "--servos", "-s")
    port: str = option("Serial port, or that of an emulator.", "--port", "-p", default="")
    report: Path | None = option("Report of the trajectory; by default the one in its folder.", default=None)
    loose: bool = option("Accept a pass under thresholds above the defaults.", "--loose-thresholds", default=False)
    feedback: bool = option("Play the balance feedback of goals that were judged with it.", default=True)
    plain: bool = option("Simulate the plain trajectory, and send it if it passes.", "--plain", default=False)
    unsafe: bool = option("Play without a passing report.", "--unsafe", default=False)
    robot: str | None = option(
        "With --plain: the robot to simulate; by default the trajectory's.", "--robot", "-r", default=None
    )
    mode: Literal["free", "pinned"] = option(
        "free (on a floor), or pinned: the robot's pelvis is fixed.", default="free"
    )
    speed: float = option("With --plain or --unsafe: factor of the trajectory's speed.", default=1.0)
    freeze: list[str] | None = option(
        "With --plain or --unsafe: joints that keep their standing angle, head_*, or another, head_pan=0.2 [rad]; repeatable.",
        default=None,
    )
    log: Path = option("The log to write (.npz).", default=Path("play.npz"))
    end_pose: bool = option("Go to the map's stop pose at the end.", default=True)
    release: bool = option("Switch torque off at the end.", "--release", default=False)
    test_lean: bool = option(
        "With feedback: lean 3° right and ahead first, and compare the inertial sensor with that.", default=True
    )
    yes: bool = option("Start the test lean without a question.", "--yes", "-y", default=False)
    grace: float = option(
        "After Ctrl-C without a way into a stand: time to hold; another Ctrl-C switches torque off [s].", default=10.0
    )
    wait: float = option("Longest wait for a missing port [s].", default=30.0, min=0)
    dry_run: bool = option("Check everything, move nothing.", "--dry-run", default=False)

    @property
    def listed(self) -> bool:
        """Whether a playlist is played."""
        return self.trajectory.suffix == ".toml"

    @property
    def altered(self) -> bool:
        """Whether the motion is other than the one in the file."""
        return self.speed != 1.0 or self.freeze is not None

    def altering(self, trajectory: "rr.Trajectory") -> "rr.Trajectory":
        """Return a trajectory at the wanted speed, with joints frozen."""
        from robot_retarget.robot.override import freeze, held
        from robot_retarget.servo.plan import at_speed

        if self.freeze:
            robot = opt.load(self.robot or trajectory.robot, servos=self.servos)
            trajectory = held(trajectory, freeze(robot, self.freeze))
        return at_speed(trajectory, self.speed)


@command(epilog="Example: robot-retarget play out/trajectory.npz --servos op3 --port /dev/ttyUSB0")
def play(how: PlayOptions, printing: opt.PrintOptions) -> None:
    """Send the goals of a trajectory that passed to Dynamixel servos. Exit code 1 when it was stopped."""
    from robot_retarget.base.files import require_writable
    from robot_retarget.servo.judgement import Piece, require_same_stands
    from robot_retarget.servo.outcome import PlaybackOptions
    from robot_retarget.servo.play import play as perform
    from robot_retarget.servo.play import preview

    options = PlaybackOptions(how.end_pose, how.release, grace=how.grace, test_lean=how.test_lean)
    servo_map = how.map_of(how.servos)
    if how.listed and (how.plain or how.unsafe or how.report is not None):
        raise UsageError("a playlist plays judged goals: --plain, --unsafe and --report take one trajectory")
    if how.plain or how.unsafe:
        pieces = [Piece((_plain if how.plain else _unjudged)(rr.load_trajectory(how.trajectory), how, servo_map))]
    else:
        pieces, tracking_rms = (_listed if how.listed else _judged)(how, servo_map)
        options = replace(options, tracking_rms=tracking_rms)
    if not how.feedback:
        pieces = [replace(piece, plan=replace(piece.plan, feedback=None)) for piece in pieces]
    if how.mode == "pinned":
        pieces = [replace(piece, plan=piece.plan.held(), ways=[way.held() for way in piece.ways]) for piece in pieces]
    elif len(pieces) > 1:
        require_same_stands(pieces, servo_map.joints)
    if how.dry_run:
        for piece in pieces:
            facts = preview(piece.plan, servo_map, how.port or None)
            title = f"Dry run {piece.name}".strip()
            printing.show(facts, lambda facts, title=title: console.table(title, ("figure", "value"), [*facts.items()]))
        return
    if not how.port:
        raise UsageError("play needs --port (or --dry-run)")
    require_writable(how.log)
    if pieces[0].plan.feedback is not None and how.test_lean and not how.yes:
        _agree()
    _await(Path(how.port), how.wait)
    say = (lambda text: None) if printing.json else console.say
    outcome = perform(pieces, servo_map, how.port, options, how.log, say)
    _show(outcome, how.log, printing)
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


def _judged(how: PlayOptions, servo_map: "ServoMap") -> "tuple[list[Piece], float]":
    """Return the goals that passed, and the largest tracking error of a joint (rms) that was judged [rad]."""
    from robot_retarget.servo.judgement import Piece, judged_ways, require_judged
    from robot_retarget.servo.plan import goal_plan

    trajectory = rr.load_trajectory(how.trajectory)
    if how.altered:
        raise UsageError(ALTERED)
    rms = require_judged(how.trajectory, trajectory, servo_map, how.servos, how.report, how.mode, how.loose)
    plan = goal_plan(trajectory, servo_map)
    if plan.feedback is not None and not how.feedback:
        raise UsageError(OPEN_LOOP)
    ways, refused = judged_ways(how.trajectory, plan, servo_map, how.servos, how.mode, how.loose)
    for reason in refused:
        console.note(f"no way into a stand: {reason}")
    return [Piece(plan, ways)], rms


def _listed(how: PlayOptions, servo_map: "ServoMap") -> "tuple[list[Piece], float]":
    """Return the pieces of a playlist, all judged, and the largest of their tracking errors [rad]."""
    from robot_retarget.servo.judgement import read_playlist

    playlist = read_playlist(how.trajectory)
    files = {*playlist.files, *([playlist.idle] if playlist.idle else [])}
    judged = {file: _judged(replace(how, trajectory=file), servo_map) for file in sorted(files)}
    named = {file: replace(pieces[0], name=str(file)) for file, (pieces, _) in judged.items()}
    return playlist.pieces(named), max(rms for _, rms in judged.values())


def _plain(trajectory: "rr.Trajectory", how: PlayOptions, servo_map: "ServoMap") -> "ServoPlan":
    """Return the goals of the plain trajectory after it passes in simulation, with feedback where the map has a sensor."""
    from robot_retarget.actuators.goals import RATE
    from robot_retarget.servo.plan import goal_plan

    model, feedback = opt.load(how.robot or trajectory.robot, servos=how.servos), None if how.feedback else False
    return goal_plan(judged_plain(how.altering(trajectory), model, how.mode, RATE, feedback), servo_map)


def _unjudged(trajectory: "rr.Trajectory", how: PlayOptions, servo_map: "ServoMap") -> "ServoPlan":
    """Return the stored goals of an unaltered trajectory, else the plain trajectory."""
    from robot_retarget.servo.plan import goal_plan, plain_plan

    if trajectory.goals is not None and not how.altered:
        return goal_plan(trajectory, servo_map)
    return plain_plan(how.altering(trajectory), servo_map)


def _show(outcome: "PlaybackOutcome", log: Path, printing: opt.PrintOptions) -> None:
    """Print how a playback ended."""
    if printing.json:
        facts = {"ended": outcome.ended.name.lower(), "state": outcome.state, "reason": outcome.reason}
        console.dump(facts | {"figures": outcome.figures, "warnings": list(outcome.warnings), "log": str(log)})
        return
    for sentence in outcome.warnings:
        console.note(sentence)
    console.show_playback(outcome.figures)
    console.say(f"{outcome.sentence}; log in {log}")
