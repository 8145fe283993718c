"""`stream`: a robot follows a performer now."""

from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

import robot_retarget as rr
from robot_retarget.base.errors import UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import command, option, options

if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.human.skeleton import Skeleton
    from robot_retarget.live.loop import Loop, Sink, StreamStats
    from robot_retarget.live.receiver import FrameSource


EMULATED = "emulated"


@options
class StreamInputOptions:
    """Where frames come from."""

    source: str = option(
        "vmc, json, xrt, isaac, or a motion file, which is played in real time.", "--from", default="vmc"
    )
    port: int | None = option("Where to listen: UDP; 39539 for vmc. json comes from stdin without.", default=None)
    host: str = option(
        "Address to listen at: this machine only by default, 0.0.0.0 for a whole network.", default="127.0.0.1"
    )
    sender: str = option("Address of the only machine that may send; by default any.", default="")
    speed: float = option("Of a motion file: times its own speed.", default=1.0)


@options
class StreamOutputOptions:
    """What poses are for."""

    target: Literal["stdout", "view", "servos"] = option("Where poses go.", "--to", default="stdout")
    servos: str | None = option(
        "Servo map (.toml) or a shipped robot's; by default the robot's own.", "--servos", "-s", default=None
    )
    serial: str = option("Serial port of the servos; `emulated` starts an emulated robot with physics.", default="")
    page: int = option("With --to view: where to serve the page; 0 takes a free port.", default=8410)
    out: Path = option("With --to view: the folder of the studio, for takes.", *opt.OUT, default=Path("studio"))
    log: Path = option("With --to servos: the log to write (.npz).", default=Path("play.npz"))


@options
class StreamOptions(opt.SceneOptions, opt.FreezeOptions, opt.LimitOptions):
    """The robot that follows."""

    robot: str = option(f"{opt.ROBOT}.", "--robot", "-r")
    lag: int = option("Frames of look-ahead: smoother and later by as many frames.", default=0, min=0, max=30)
    calibrate: Path | None = option(
        "Bone lengths, floor and facing (.npz): taken from it, and kept in it at the end.", default=None
    )
    seconds: float | None = option(
        "Duration from the first frame on, and longest wait for it [s]; by default until Ctrl-C.", default=None, min=0.1
    )


@command(epilog="Example: robot-retarget stream --robot op3 --from vmc --to view")
def stream(
    how: StreamOptions, source: StreamInputOptions, place: StreamOutputOptions, printing: opt.PrintOptions
) -> None:
    """Have a robot follow a performer live. Ctrl-C ends it with a summary; exit code 1 when servos were stopped."""
    from robot_retarget.base.files import require_suffix, require_writable
    from robot_retarget.live.sources import opened

    if how.calibrate is not None:
        require_suffix(how.calibrate, ".npz", "calibrations are arrays")
        require_writable(how.calibrate)
    model = how.of(opt.load(how.robot, how.limits, place.servos))
    around = None if how.scene is None else replace(rr.read_scene(how.scene), scale=how.scale)
    with closing(opened(**vars(source), scene=around, say=console.to_stderr)) as frames:
        seconds = float("inf") if how.seconds is None else how.seconds
        poses = StreamRun(model, frames, how.lag, how.calibrate, seconds, around)
        figures, code = _SHOWN[place.target](poses, place)
    if printing.json:
        console.dump(figures, side=place.target == "stdout")
    else:
        console.show_stream(figures)
    if how.seconds is not None and not figures["frames"]:
        at = f" at {source.host}:{source.port or source.source}" if source.port or source.source == "vmc" else ""
        raise UsageError(f"no frame of a performer arrived{at} within {how.seconds:g} s")
    raise typer.Exit(code)


@dataclass(frozen=True, eq=False)
class StreamRun:
    """A robot that follows frames."""

    robot: "rr.Robot"
    source: "FrameSource"
    lag: int
    calibrate: Path | None
    seconds: float
    scene: "rr.Scene | None" = None

    def loop(self, sink: "Sink") -> "Loop":
        """The loop into a sink."""
        from robot_retarget.live.loop import Loop
        from robot_retarget.live.sources import load_calibration
        from robot_retarget.solver.stream import Stream

        path = self.calibrate
        known = None if path is None or not path.exists() else load_calibration(path)

        def stream_of(skeleton: "Skeleton") -> Stream:
            return Stream(self.robot, skeleton, calibration=known, lag=self.lag, scene=self.scene)

        return Loop(self.source, stream_of, sink, console.to_stderr)

    def run(self, sink: "Sink", begun: "Callable[[Loop], None]" = lambda loop: None) -> dict[str, Any]:
        """Run in this thread until Ctrl-C and return the figures; `begun` gets the loop first."""
        from robot_retarget.servo.host import handling

        loop = self.loop(sink)
        begun(loop)
        with handling(lambda number: loop.stop.set()):
            tally = loop.run(self.seconds)
        self.save_calibration(loop)
        return self.figures(loop, tally)

    def figures(self, loop: "Loop", tally: "StreamStats") -> dict[str, Any]:
        """Figures of the summary, with the faults of the source and of the stream."""
        found = tally.figures(self.source)
        return found | {"faults": {**found["faults"], **getattr(loop.stream, "faults", {})}}

    def save_calibration(self, loop: "Loop") -> None:
        """Save the calibration of the performer if a file for it is given."""
        from robot_retarget.live.sources import save_calibration

        learnt = getattr(loop.stream, "calibration", None)
        if self.calibrate is not None and learnt is not None:
            save_calibration(learnt, self.calibrate)
            console.to_stderr(f"saved the calibration of the performer in {self.calibrate}")


def _to_stdout(poses: StreamRun, place: StreamOutputOptions) -> tuple[dict[str, Any], int]:
    import sys

    from robot_retarget.live.sinks import LineSink

    return poses.run(LineSink(sys.stdout)), 0


def _to_page(poses: StreamRun, place: StreamOutputOptions) -> tuple[dict[str, Any], int]:
    from threading import Thread

    from robot_retarget.tools.studio.studio import Studio
    from robot_retarget.tools.view.web.live import PageSink

    sink = PageSink(poses.robot, poses.scene, _heard_at(poses.source))
    served = Studio(place.out, sink.robot).served(place.page)
    console.to_stderr(f"{served.address} shows it; from elsewhere first: {served.tunnel_command()}")
    thread = Thread(target=served.forever, daemon=True)
    thread.start()
    try:
        return poses.run(sink, sink.follow), 0
    finally:
        served.close()
        if take := sink.robot.end():
            console.to_stderr(f"wrote {take['wrote']}, {take['seconds']} s")
        thread.join()


def _heard_at(source: "FrameSource") -> str:
    """Return where frames come from, or the address that a performer sends them to."""
    from robot_retarget.live.receiver import Receiver, UdpPort

    port = source.port if isinstance(source, Receiver) else None
    if not isinstance(port, UdpPort):
        return "standard input" if port else "a headset" if source.skeleton is None else "a file"
    host, number = port.address
    return f"UDP {_reachable(host)}:{number}"


def _reachable(host: str) -> str:
    """Return the address of this machine in its network, in place of the wildcard address."""
    import socket

    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends no packet; the system chooses the interface
            return str(probe.getsockname()[0])
        except OSError:
            return host


def _to_servos(poses: StreamRun, place: StreamOutputOptions) -> tuple[dict[str, Any], int]:
    from robot_retarget.base.files import require_writable
    from robot_retarget.live.sinks import ServoSink, run_servos
    from robot_retarget.servo.play import emulator_process

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
    return poses.figures(loop, tally) | {"servos": outcome.figures | {"ended": outcome.sentence}}, outcome.exit_code


def _map_of(robot: "rr.Robot", servos: str | None) -> "ServoMap":
    from robot_retarget.actuators.map import load_map

    if servos is not None:
        return load_map(servos)
    if robot.servo_map is None:
        raise UsageError(f"{robot.name} has no servo map of its own: --servos MAP.toml")
    return robot.servo_map


_SHOWN = {"stdout": _to_stdout, "view": _to_page, "servos": _to_servos}
