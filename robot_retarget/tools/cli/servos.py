"""The group `servos`: emulate, scan, check, calibrate, record, identify, predict, import, map."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import robot_retarget as rr
from robot_retarget.base.errors import ServoError, UsageError
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import app, command, option, options

if TYPE_CHECKING:
    from robot_retarget.actuators.map import ServoMap
    from robot_retarget.actuators.motors import Pendulum
    from robot_retarget.servo.emulator.server import WireTiming
    from robot_retarget.servo.identify import Fit
    from robot_retarget.servo.recording import HandTake

servos: typer.Typer = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Dynamixel servos, real or emulated."
)
app.add_typer(servos, name="servos")

UNITS = {
    "damping": "N m s/rad in addition to the back-EMF",
    "friction": "N m",
    "armature": "kg m²",
    "gain": "of the datasheet's",
}
"""Of what `identify` finds."""


@options
class MapNameOptions:
    """The map of a robot's servos."""

    map_name: str = option("A shipped robot's name (op3) or a servo map (.toml).", "--map", "-m")


@options
class BusOptions(opt.BaudOptions, MapNameOptions):
    """The servos of a map on a port."""

    port: str = option("Serial port, or that of an emulator.", "--port", "-p")

    def load(self) -> "ServoMap":
        """Return the map, with the wanted baud rate."""
        return self.map_of(self.map_name)


@options
class MapOutputOptions:
    """The map that a command writes."""

    output: Path = option("The map to write (.toml).", *opt.OUT)


@options
class EmulateOptions(MapNameOptions):
    """The emulated robot, its wires and its faults."""

    link: Path | None = option("A stable name for the port.", default=None)
    physics: bool = option("Put the robot's MuJoCo model behind the servos.", default=False)
    model: Path | None = option(
        "MJCF or URDF for --physics, as `run` takes it; the shipped robot's by default.", default=None
    )
    pendulum: str = option(
        "MASS,LENGTH [kg, m] on the shaft of every servo, for `identify`; without --physics.", default=""
    )
    view: bool = option("With --physics: show the robot in a window.", "--view", default=False)
    baud: int | None = option("Bytes take the time of this baud rate; by default none.", default=None)
    usb_latency: float = option("With --baud: delay that a USB adapter adds to an answer [ms].", default=0.0)
    return_delay: int = option("Register 9 of every servo [2 µs]; new servos have 250.", default=0)
    fault: list[str] | None = option("Fault to inject, e.g. 'after 2 silent 3'.", default=None)
    strict: bool = option("Silent at a wrong baud rate and to frames without stuffing.", default=False)
    control: bool = option("Read faults and `state` from stdin.", default=False)
    lockstep: float | None = option(
        "Each frame of goals advances time by a tick, at this rate; the clock is ignored.",
        default=None,
        min=10,
        max=1000,
    )


@command(group=servos, epilog="Example: robot-retarget servos emulate --map op3 --physics --link /tmp/ttyDXL")
def emulate(how: EmulateOptions) -> None:
    """Run an emulated bus on a pseudo terminal.

    It prints `ready PATH` and stops on SIGTERM.
    """
    from robot_retarget.actuators.map import load_map
    from robot_retarget.servo.emulator import emulator, scene_of

    for name, why in (("view", "there is no robot to show"), ("model", "the motors turn alone")):
        if getattr(how, name) and not how.physics:
            raise UsageError(f"--{name} needs --physics: without it {why}")
    if how.pendulum and how.physics:
        raise UsageError("--pendulum loads separate motors; with --physics the model is the load")
    servo_map = load_map(how.map_name)
    body = (opt.load(str(how.model)).spec() if how.model else scene_of(servo_map.robot)) if how.physics else None
    pace, weight = _pace(how.baud, how.usb_latency), _pendulum(how.pendulum) if how.pendulum else None
    what = (how.strict, how.return_delay, how.view, how.lockstep, weight)
    emulator(servo_map, how.link, pace, body, how.fault or (), *what).run(how.control)


@command(group=servos, epilog="Example: robot-retarget servos scan --port /dev/ttyUSB0")
def scan(
    printing: opt.PrintOptions,
    port: Annotated[str, typer.Option("--port", "-p", help="Serial port, or that of an emulator.")],
    baud: Annotated[list[int] | None, typer.Option(help="Baud rates to try; the usual ones by default.")] = None,
    last: Annotated[int, typer.Option(min=0, max=252, help="Highest id to try.")] = 252,
) -> None:
    """Find the servos on a port, at every baud rate."""
    from robot_retarget.servo.drafting import find_servos

    heads, found = ("id", "model", "firmware", "baud", "protocol"), list[dict[str, Any]]()
    for one in find_servos(port, baud or (), last):
        row = one._asdict() | {"model": one.model.name if one.model else f"model {one.number}"}
        found.append({head: row[head] for head in heads})
    printing.show(found, lambda _: console.table("Servos", heads, [tuple(row.values()) for row in found]))
    if len({row["protocol"] for row in found}) > 1:
        console.note("Servos of Protocol 1 and 2 share the port: give each protocol a port and a map of its own.")
    if not found:
        raise ServoError(f"no servo answers on {port} (power, cable, --baud)")


@command(group=servos, epilog="Example: robot-retarget servos check --map op3 --port /dev/ttyUSB0")
def check(
    at: BusOptions,
    printing: opt.PrintOptions,
    fix: Annotated[bool, typer.Option("--fix", help="Write what can be put right, where torque is off.")] = False,
) -> None:
    """Compare the servos with the map; every difference at once. Exit code 1 when playing would be refused."""
    from robot_retarget.servo.bus import Bus
    from robot_retarget.servo.check import check as ask
    from robot_retarget.servo.check import fix as put_right

    servo_map = at.load()
    with Bus(at.port, servo_map.baud, version=servo_map.protocol) as bus:
        conditions, findings = ask(bus, servo_map)
        done = put_right(bus, servo_map, findings) if fix else []
        if done:
            conditions, findings = ask(bus, servo_map)
    rows = {c.servo.joint: {"angle_rad": round(c.angle, 4), **c.values} for c in conditions}
    sentences, asked = [*map(str, findings)], len(servo_map.servos)
    answer = f"{len(conditions)} of {asked} servos answer as they should; {len(findings)} differences"
    facts = {"servos": rows, "findings": sentences, "fixed": done}
    printing.result(facts, "\n".join([*done, *sentences, answer]))
    raise typer.Exit(1 if any(f.grave for f in findings) else 0)


@command(group=servos, epilog="Example: robot-retarget servos calibrate --map op3 --port /dev/ttyUSB0 -o my_op3.toml")
def calibrate(
    at: BusOptions,
    to: MapOutputOptions,
    printing: opt.PrintOptions,
    joint: Annotated[list[str] | None, typer.Option(help="Only these joints.")] = None,
) -> None:
    """Record where the servos are now as the zero pose.

    Bring the robot there by hand first, torque off.
    """
    from robot_retarget.actuators.map import with_zeros
    from robot_retarget.base.files import write_text
    from robot_retarget.servo.bus import Bus
    from robot_retarget.servo.check import record_zeros

    servo_map = at.load()
    with Bus(at.port, servo_map.baud, version=servo_map.protocol) as bus:
        new = record_zeros(bus, servo_map, joint or servo_map.joints)
    write_text(to.output, with_zeros(at.map_name, new))
    moved = {b.joint: [a.zero, b.zero] for a, b in zip(servo_map.servos, new.servos, strict=True) if a.zero != b.zero}
    lines = [f"{name}: zero {before} -> {now}" for name, (before, now) in moved.items()]
    printing.result({"output": str(to.output), "zeros": moved}, "\n".join([*lines, f"wrote {to.output}"]))


@command("map", group=servos, epilog="Example: robot-retarget servos map new.toml --robot my.xml --scan /dev/ttyUSB0")
def draft_map(
    printing: opt.PrintOptions,
    output: Annotated[Path, typer.Argument(help="The map to write (.toml).")],
    robot: Annotated[str, typer.Option("--robot", "-r", help="The robot's model: MJCF, URDF or a name.")],
    scan: Annotated[str, typer.Option(help="Serial port of its servos, or that of an emulator.")],
    baud: Annotated[list[int] | None, typer.Option(help="Baud rates to try; the usual ones by default.")] = None,
    last: Annotated[int, typer.Option(min=0, max=252, help="Highest id to try.")] = 252,
) -> None:
    """Draft the servo map of a new robot.

    Bring it into its zero pose, torque off. Each servo moves by 9° and back, one after the other; type which joint moved, and + or -.
    """
    from robot_retarget.actuators.map import dump_map
    from robot_retarget.base.files import require_writable, write_text
    from robot_retarget.robot.anatomy import positive_senses
    from robot_retarget.servo.drafting import FoundServo, draft

    model = opt.load(robot)
    require_writable(output)
    ranges = {j: (float(a), float(b)) for j, a, b in zip(model.joint_names, model.lower, model.upper, strict=True)}
    senses = positive_senses(model)
    console.to_stderr("\n".join(f"{joint}: + turns it {sense}" for joint, sense in senses.items()))

    def ask(one: FoundServo) -> str:
        named = one.model.name if one.model else ""
        return typer.prompt(f"servo {one.id} ({named}) moved: joint and + or -, or Enter", default="", err=True)

    servo_map = draft(model.name, ranges, scan, ask, baud or (), last)
    write_text(output, dump_map(servo_map))
    free = [joint for joint in ranges if joint not in servo_map.joints]
    rest = f"; without a servo: {', '.join(free)}" if free else ""
    sentence = f"wrote {output}: {len(servo_map.servos)} servos{rest}; `servos check` and `calibrate` come next"
    printing.result({"output": str(output), "servos": len(servo_map.servos), "without": free}, sentence)


@options
class RecordOptions(BusOptions):
    """The take."""

    output: Path = option("The trajectory to write (.npz).", *opt.OUT)
    limp: list[str] | None = option(
        "Limbs (l_arm, right_leg, head), joints or patterns whose torque is switched off; repeatable. Without it, all.",
        default=None,
    )
    seconds: float | None = option("Duration; without it, until Ctrl-C or the space bar [s].", default=None, min=0.1)
    countdown: int = option("Time from torque on everywhere to the take [s].", default=3, min=0, max=60)
    smooth: float | None = option(
        "Time over which cubics are fitted to the angles; 0 for none, 0.18 by default [s].", default=None, min=0, max=2
    )
    robot: str | None = option("The robot's name or model; by default that of the map.", "--robot", "-r", default=None)
    log: Path = option("The log to write (.npz).", default=Path("record.npz"))


@command(
    group=servos, epilog="Example: robot-retarget servos record --map op3 --port /dev/ttyUSB0 --limp l_arm -o wave.npz"
)
def record(how: RecordOptions, printing: opt.PrintOptions) -> None:
    """Record a motion that a person makes with the robot's joints.

    The other joints hold. 50 poses a second; `simulate` and `play` take the file as any other.
    """
    from robot_retarget.base.files import require_writable
    from robot_retarget.robot import recognise
    from robot_retarget.robot.anatomy import joints_by_limb
    from robot_retarget.servo.recording import FITTED, limp_joints
    from robot_retarget.servo.recording import record as perform

    servo_map = how.load()
    robot = opt.load(how.robot or servo_map.robot, servos=how.map_name)
    limbs = joints_by_limb(robot, recognise(robot))
    limp = limp_joints(servo_map, how.limp or servo_map.joints, limbs)
    for path in (how.output, how.log):
        require_writable(path)
    say = (lambda text: None) if printing.json else console.say
    take, outcome = perform(servo_map, how.port, limp, how.seconds, how.countdown, None, how.log, say)
    span = FITTED if how.smooth is None else how.smooth
    facts = {"ended": outcome.ended.name.lower(), "state": outcome.state, "reason": outcome.reason}
    lines = [outcome.sentence]
    if len(take.angles) > 1:
        _trajectory(take.smoothed(span), robot, servo_map).save(how.output)
        facts |= {"output": str(how.output), "poses": len(take.angles), "smoothed_s": span}
        way = f"each angle is that of a cubic through {span:g} s around it" if span else "not smoothed"
        lines.append(f"wrote {how.output}: {len(take.angles)} poses, {take.rate:g} a second; {way}")
    printing.result(facts, "\n".join(lines))
    raise typer.Exit(outcome.exit_code)


def _trajectory(take: "HandTake", robot: "rr.Robot", servo_map: "ServoMap") -> "rr.Trajectory":
    """Return a take as a trajectory of a robot in its standing place; joints without a servo keep their standing angle."""
    import numpy as np

    qpos = np.tile(robot.standing(), (len(take.angles), 1))
    for joint, angles in zip(servo_map.joints, take.angles.T, strict=True):
        qpos[:, robot.qpos_index[robot.joint_names.index(joint)]] = angles
    return rr.Trajectory(qpos, take.rate, robot.joint_names, robot.name, "recorded by hand")


@options
class IdentifyOptions(MapOutputOptions, BusOptions):
    """The servo and its load."""

    joint: str = option("The joint whose servo turns the pendulum, 0 rad where it hangs; or a joint of the robot.")
    port: str = option("Serial port, or that of an emulator; not with --from.", "--port", "-p", default="")
    source: Path | None = option("A play.npz of the robot, in place of a pendulum.", "--from", default=None)
    robot: str | None = option(
        "With --from: the robot's model; by default that of the map.", "--robot", "-r", default=None
    )
    picture: Path | None = option("With --from: predicted and played angles (.svg).", default=None)
    mass: float = option("Of the pendulum [kg].", default=0.0)
    length: float = option("From the axis to its centre of mass [m].", default=0.0)
    inertia: float = option("About the axis [kg m²]; by default that of a point mass.", default=0.0)
    log: Path = option("The log to write (.npz).", default=Path("identify.npz"))


@command(
    group=servos,
    epilog="Example: robot-retarget servos identify --map bench.toml --joint j1 --mass 0.3 --length 0.1 --port /dev/ttyUSB0 -o new.toml",
)
def identify(how: IdentifyOptions, printing: opt.PrintOptions) -> None:
    """Find a servo's friction, armature, damping and gain.

    It moves with a known pendulum for 24 s; the model is fitted. Or from a playback (--from), whose limb is the load: trunk held or
    still, limb in the air.
    """
    from robot_retarget.actuators.map import dump_map
    from robot_retarget.actuators.motors import Pendulum
    from robot_retarget.base.files import require_writable, write_text
    from robot_retarget.servo.identify import identify as find
    from robot_retarget.servo.identify import with_identified

    servo_map = how.load()
    for path in (how.output, how.log):
        require_writable(path)
    if how.source is not None:
        found = _from_log(how, servo_map)
    elif not how.port:
        raise UsageError("identify needs --port with --mass and --length, or --from play.npz")
    else:
        found = find(servo_map, how.joint, Pendulum(how.mass, how.length, how.inertia), how.port, how.log)
    write_text(how.output, dump_map(with_identified(servo_map, how.joint, found.servo)))
    facts = {**vars(found.servo), "delay_s": round(found.delay, 5), "error_rad": round(found.error, 5)}
    facts |= {"supply_V": round(found.voltage, 2), "weight_factor": round(found.weight, 3)}
    lines = [
        f"{name} {getattr(found.servo, name):g} ± {spread:.2g} {UNITS[name]}".rstrip()
        for name, spread in found.spread.items()
    ]
    off = f"simulated angles are {found.error:.4f} rad off on average, {1000 * found.delay:.1f} ms late"
    facts["standard_errors"] = {name: float(f"{spread:.3g}") for name, spread in found.spread.items()}
    lines += [f"at {found.voltage:.1f} V; {off}", f"wrote {how.output}"]
    printing.result({"output": str(how.output), **facts}, "\n".join(lines))


def _from_log(how: IdentifyOptions, servo_map: "ServoMap") -> "Fit":
    """Fit a joint of a playback, and draw the prediction of the fit."""
    from dataclasses import replace

    from robot_retarget.actuators.map import Stop
    from robot_retarget.base.files import write_text
    from robot_retarget.servo.identify import from_log, with_identified
    from robot_retarget.servo.played import read_play_log
    from robot_retarget.servo.predict import predict as of_log
    from robot_retarget.servo.twin import limb_torques
    from robot_retarget.tools.view.charts import predictions

    log = read_play_log(how.source or "")
    servo_map[how.joint]
    loads = limb_torques(opt.load(how.robot or servo_map.robot).spec(), log)
    column = loads[:, log.joints.index(how.joint)]
    found = from_log(log, servo_map, how.joint, column)
    if how.picture is not None:
        alone = replace(servo_map, servos=(servo_map[how.joint],), stop=Stop())
        made = of_log(log, with_identified(alone, how.joint, found.servo), column)
        write_text(how.picture, predictions(made, log.rate).svg)
    return found


@command(group=servos, epilog="Example: robot-retarget servos predict play.npz --map op3 --picture predict.svg")
def predict(
    the: MapNameOptions,
    printing: opt.PrintOptions,
    log: Annotated[
        Path, typer.Argument(help="play.npz, or the folder of a LeRobot data set (action, observation.state).")
    ],
    unit: Annotated[Literal["rad", "deg"], typer.Option(help="Of the angles of a LeRobot data set.")] = "rad",
    load: Annotated[float, typer.Option(help="Inertia that each joint carries [kg m²].", min=0)] = 0.0,
    picture: Annotated[Path | None, typer.Option(help="Goals, predicted and measured angles (.svg).")] = None,
) -> None:
    """Predict the angles of a log from its goals by the servo model.

    It prints the error of each joint.
    """
    import numpy as np

    from robot_retarget.actuators.map import load_map
    from robot_retarget.base.files import write_text
    from robot_retarget.formats.lerobot import read_actions
    from robot_retarget.servo.played import ServoLog, read_play_log
    from robot_retarget.servo.predict import predict as of_log
    from robot_retarget.tools.view.charts import predictions

    servo_map = load_map(the.map_name)
    if log.is_dir():
        joints, fps, goals, states = read_actions(log)
        factor = np.radians(1.0) if unit == "deg" else 1.0
        found = ServoLog(joints, fps, factor * goals, factor * states)
    else:
        found = read_play_log(log)
    made = of_log(found, servo_map, load)
    rows = [
        {"joint": one.joint, "model": one.model, "error_deg": round(float(np.degrees(one.error)), 3)}
        | {"error_of_goals_deg": round(float(np.degrees(one.error_of_goals)), 3)}
        for one in made
    ]
    heads = ("joint", "model", "predicted [° rms]", "goals alone [° rms]")
    printing.show(rows, lambda _: console.table("Predicted", heads, [tuple(row.values()) for row in rows]))
    if picture is not None:
        write_text(picture, predictions(made, found.rate).svg)


@command(
    "import", group=servos, epilog="Example: robot-retarget servos import OP3.robot --offsets offset.yaml -o op3.toml"
)
def import_map(
    to: MapOutputOptions,
    printing: opt.PrintOptions,
    file: Annotated[Path, typer.Argument(help="OP3.robot, lerobot or pypot JSON, ToddlerBot config.json.")],
    offsets: Annotated[Path | None, typer.Option(help="offset.yaml next to an OP3.robot.")] = None,
    model: Annotated[str | None, typer.Option(help="Servo model where the file names none.")] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", "-r", help="The robot's model: signs and zeros are taken that fit its ranges."),
    ] = None,
) -> None:
    """Make a servo map from another project's configuration."""
    from robot_retarget.actuators.map import dump_map
    from robot_retarget.base.files import write_text
    from robot_retarget.servo.foreign import by_servos, read_foreign

    servo_map = read_foreign(file, offsets, model)
    if robot is not None:
        body = opt.load(robot)
        ends = {joint: each for joint, *each in zip(body.joint_names, body.lower, body.upper, strict=True)}

        def distance(found: "ServoMap") -> float:
            servos = [servo for servo in found.servos if servo.joint in ends]
            return sum(abs(s.lower - ends[s.joint][0]) + abs(s.upper - ends[s.joint][1]) for s in servos)

        servo_map = min(servo_map, by_servos(servo_map), key=distance)
    write_text(to.output, dump_map(servo_map))
    cut, count = [servo.joint for servo in servo_map.servos if servo.range_exceeds_turn], len(servo_map.servos)
    sentence = f"wrote {to.output}: {count} servos; look over signs, zeros and ranges before playing"
    printing.result({"output": str(to.output), "servos": count, "cut": cut}, sentence)
    if cut:
        console.note(f"The one turn of position mode cuts the range of {', '.join(cut)}.")


def _pendulum(text: str) -> "Pendulum":
    from robot_retarget.actuators.motors import Pendulum

    try:
        mass, length = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"--pendulum {text!r} is not MASS,LENGTH, such as 0.3,0.1") from None
    return Pendulum(mass, length)


def _pace(baud: int | None, usb_latency: float) -> "WireTiming":
    from robot_retarget.servo.emulator.server import WireTiming

    if usb_latency and baud is None:
        raise UsageError("--usb-latency needs --baud")
    return WireTiming(baud, usb_latency / 1000)
