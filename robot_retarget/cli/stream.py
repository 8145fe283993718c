"""`stream`: a robot follows a performer now, and a sender to try that with."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Freeze, Json, Limits, Only, Quiet
from robot_retarget.errors import UsageError, known

if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.live.loop import Loop, Sink
    from robot_retarget.live.receiver import FrameSource
    from robot_retarget.motion import Skeleton
    from robot_retarget.robot import Robot

commands: typer.Typer = typer.Typer()

SINKS = ("stdout", "view", "mujoco", "servos")
EMULATED = "emulated"


@commands.command(epilog="Example: robot-retarget stream --robot op3 --from vmc --to view")
def stream(
    robot: Annotated[
        str | None,
        typer.Option("--robot", "-r", help="A shipped name (op3), an MJCF file, or a robot_descriptions name."),
    ] = None,
    source: Annotated[
        str, typer.Option("--from", help="vmc, json, floats, or a motion file, which is played in real time.")
    ] = "vmc",
    target: Annotated[
        str,
        typer.Option(
            "--to", help="stdout, view, mujoco or servos; with --send vmc://HOST:PORT, json://… or floats://…."
        ),
    ] = "stdout",
    port: Annotated[
        int | None,
        typer.Option(help="Where to listen: UDP; 39539 for vmc. json and floats come from stdin without."),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen at: this machine only by default, 0.0.0.0 for a whole network.")
    ] = "127.0.0.1",
    sender: Annotated[str, typer.Option(help="Address of the only machine that may send; by default any.")] = "",
    tcp: Annotated[bool, typer.Option("--tcp", help="json and floats over TCP, not UDP.")] = False,
    skeleton: Annotated[Path | None, typer.Option(help="Motion file with the joints of the floats protocol.")] = None,
    servos: Annotated[
        str | None,
        typer.Option("--servos", "-s", help="Servo map (.toml) or a shipped robot's; by default the robot's own."),
    ] = None,
    serial: Annotated[
        str, typer.Option(help="Serial port of the servos; `emulated` starts an emulated robot with physics.")
    ] = "",
    mode: Annotated[
        Literal["pinned", "free"], typer.Option(help="With --to mujoco: pinned (the pelvis is held) or free.")
    ] = "pinned",
    window: Annotated[bool, typer.Option("--window", help="With --to mujoco: show it in a window.")] = False,
    page: Annotated[int, typer.Option(help="With --to view: where to serve the page; 0 takes a free port.")] = 8410,
    lag: Annotated[
        int, typer.Option(min=0, max=30, help="Frames of look-ahead: smoother and later by as many frames.")
    ] = 0,
    calibrate: Annotated[
        Path | None,
        typer.Option(help="Bone lengths, floor and facing (.npz): taken from it, and kept in it at the end."),
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.1, help="Duration [s]; by default until Ctrl-C.")] = None,
    log: Annotated[Path, typer.Option(help="With --to servos: the log to write (.npz).")] = Path("play.npz"),
    send: Annotated[Path | None, typer.Option(help="Send this motion file as a performer would, instead.")] = None,
    fps: Annotated[
        float | None, typer.Option(help="With --send: frames a second; by default the motion's own.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Of a motion file: times its own speed.")] = 1.0,
    freeze: Freeze = None,
    only: Only = None,
    limits: Limits = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Have a robot follow a performer live. Ctrl-C ends it with a summary; exit code 1 when servos were stopped."""
    from robot_retarget.files import require_suffix, require_writable

    if send is not None:
        _send(send, target, fps, speed, seconds, json)
        return
    if robot is None:
        raise UsageError("stream needs --robot, or --send and a target to send to")
    if calibrate is not None:
        require_suffix(calibrate, ".npz", "calibrations are arrays")
        require_writable(calibrate)
    if target not in SINKS:
        raise UsageError(
            f"--to {target!r} is no place for poses; {known(SINKS, typed=target)}; with --send it is vmc://HOST:PORT"
        )
    from robot_retarget.cli.stages import load

    model = load(robot, limits, servos, freeze, only)
    with _opened(StreamInput(source, port, host, tcp, sender, skeleton, speed)) as frames:
        poses = StreamRun(model, frames, lag, calibrate, float("inf") if seconds is None else seconds)
        figures, code = _SHOWN[target](poses, StreamOutput(servos, serial, mode, window, page, log))
    _tell(figures, json, target)
    raise typer.Exit(code)


@dataclass(frozen=True)
class StreamInput:
    """Where frames come from."""

    source: str
    port: int | None
    host: str
    tcp: bool
    sender: str
    skeleton: Path | None
    speed: float


@dataclass(frozen=True)
class StreamOutput:
    """What poses are for."""

    servos: str | None
    serial: str
    mode: str
    window: bool
    page: int
    log: Path


@dataclass(frozen=True, eq=False)
class StreamRun:
    """A robot that follows frames."""

    robot: "Robot"
    source: "FrameSource"
    lag: int
    calibrate: Path | None
    seconds: float

    def loop(self, sink: "Sink") -> "Loop":
        """The loop into a sink."""
        from robot_retarget.live.calibration import load_calibration
        from robot_retarget.live.loop import Loop
        from robot_retarget.solve.live.stream import Stream

        path = self.calibrate
        known = None if path is None or not path.exists() else load_calibration(path)

        def stream_of(skeleton: "Skeleton") -> Stream:
            return Stream(self.robot, skeleton, calibration=known, lag=self.lag)

        return Loop(self.source, stream_of, sink, console.to_stderr)

    def run(self, sink: "Sink") -> dict[str, Any]:
        """Run in this thread until Ctrl-C and return the figures."""
        loop = self.loop(sink)
        with _stopping_on_signals(loop.stop.set):
            tally = loop.run(self.seconds)
        self.save_calibration(loop)
        return tally.figures(self.source)

    def save_calibration(self, loop: "Loop") -> None:
        """Save the calibration of the performer if a file for it is given."""
        from robot_retarget.live.calibration import save_calibration

        learnt = getattr(loop.stream, "calibration", None)
        if self.calibrate is not None and learnt is not None:
            save_calibration(learnt, self.calibrate)
            console.to_stderr(f"saved the calibration of the performer in {self.calibrate}")


@contextmanager
def _opened(wanted: StreamInput) -> "Iterator[FrameSource]":
    """A source, closed at the end."""
    from robot_retarget.live.open import opened

    source = opened(**vars(wanted), say=console.to_stderr)
    try:
        yield source
    finally:
        source.close()


@contextmanager
def _stopping_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM ask; they do not kill."""
    import signal

    numbers = signal.SIGINT, signal.SIGTERM
    before = {number: signal.signal(number, lambda *_: stop()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _to_stdout(poses: StreamRun, place: StreamOutput) -> tuple[dict[str, Any], int]:
    import sys

    from robot_retarget.live.sinks.lines import LineSink

    return poses.run(LineSink(sys.stdout)), 0


def _to_page(poses: StreamRun, place: StreamOutput) -> tuple[dict[str, Any], int]:
    from threading import Thread

    from robot_retarget.live.sinks.page import PageSink

    sink = PageSink(poses.robot, place.page)
    console.to_stderr(f"{sink.served.address} shows it; from elsewhere first: {sink.served.tunnel_command()}")
    thread = Thread(target=sink.served.forever, daemon=True)
    thread.start()
    try:
        return poses.run(sink), 0
    finally:
        sink.served.server.shutdown()
        thread.join()


def _to_physics(poses: StreamRun, place: StreamOutput) -> tuple[dict[str, Any], int]:
    from robot_retarget.live.sinks.physics import PhysicsSink

    sink = PhysicsSink(poses.robot, place.mode, place.window)
    try:
        figures = poses.run(sink)
    finally:
        sink.close()
    return figures | sink.figures(), 0


def _to_servos(poses: StreamRun, place: StreamOutput) -> tuple[dict[str, Any], int]:
    from robot_retarget.files import require_writable
    from robot_retarget.live.sinks.servos import ServoSink, run_servos
    from robot_retarget.servo.emulated import emulator_process

    servo_map = _map_of(poses.robot, place.servos)
    if not place.serial:
        raise UsageError(f"--to servos needs --serial PORT, or --serial {EMULATED}")
    require_writable(place.log)
    console.note("live poses are not judged beforehand: hang the robot up, and keep the switch of its supply in reach")
    sink = ServoSink(poses.robot, servo_map)
    emulated = place.serial == EMULATED
    with emulator_process(servo_map, "--physics") if emulated else nullcontext(place.serial) as serial:
        loop = poses.loop(sink)
        outcome, tally = run_servos(loop, sink, servo_map, serial, poses.seconds, place.log, console.to_stderr)
    poses.save_calibration(loop)
    for sentence in outcome.warnings:
        console.note(sentence)
    console.to_stderr(f"{outcome.sentence}; log in {place.log}")
    return tally.figures(poses.source) | {"servos": outcome.figures | {"ended": outcome.sentence}}, outcome.exit_code


def _map_of(robot: "Robot", servos: str | None) -> "ServoMap":
    from robot_retarget.actuators.map import load_map

    if servos is not None:
        return load_map(servos)
    if robot.servo_map is None:
        raise UsageError(f"{robot.name} has no servo map of its own: --servos MAP.toml")
    return robot.servo_map


_SHOWN = {"stdout": _to_stdout, "view": _to_page, "mujoco": _to_physics, "servos": _to_servos}


def _send(clip: Path, target: str, fps: float | None, speed: float, seconds: float | None, json: bool) -> None:
    from threading import Event

    from robot_retarget.cli.stages import read_clip
    from robot_retarget.live.open import require_osc

    require_osc()
    from robot_retarget.live.send import send

    motion, stop = read_clip(clip, None), Event()
    motion = motion if fps is None else motion.resample(fps)
    console.to_stderr(f"sending {motion.fps * speed:g} frames a second to {target}")
    with _stopping_on_signals(stop.set):
        figures = send(motion, target, speed, seconds, stop)
    console.dump(figures) if json else console.to_stderr(f"sent {figures['frames']} frames in {figures['seconds']:g} s")


def _tell(figures: dict[str, Any], json: bool, target: str) -> None:
    """Print the summary; on stderr if stdout carries the poses."""
    if json:
        console.dump(figures, side=target == "stdout")
    else:
        console.show_stream(figures)
