"""The group `servos`: emulate, scan, check, calibrate, identify, import."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.cli import console
from robot_retarget.cli.options import Baud, Json, Port, Quiet
from robot_retarget.errors import ServoError, UsageError

if TYPE_CHECKING:
    from robot_retarget.servo.emulator.wire_timing import WireTiming
    from robot_retarget.servo.pendulum import Pendulum

commands: typer.Typer = typer.Typer()
servos: typer.Typer = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Dynamixel servos, real or emulated."
)
commands.add_typer(servos, name="servos")

UNITS = {
    "damping": "N m s/rad besides the back-EMF",
    "friction": "N m",
    "armature": "kg m²",
    "gain": "of the datasheet's",
}
"""Of what `identify` finds."""
MapName = Annotated[str, typer.Option("--map", "-m", help="A shipped robot's name (op3) or a servo map (.toml).")]


@servos.command(epilog="Example: robot-retarget servos emulate --map op3 --physics --link /tmp/ttyDXL")
def emulate(
    map_name: MapName,
    link: Annotated[Path | None, typer.Option(help="A stable name for the port.")] = None,
    physics: Annotated[bool, typer.Option(help="Put the robot's MuJoCo model behind the servos.")] = False,
    model: Annotated[Path | None, typer.Option(help="MJCF for --physics; the shipped robot's by default.")] = None,
    pendulum: Annotated[
        str, typer.Option(help="MASS,LENGTH [kg, m] on the shaft of every servo, for `identify`; without --physics.")
    ] = "",
    view: Annotated[bool, typer.Option("--view", help="With --physics: show the robot in a window.")] = False,
    baud: Annotated[int | None, typer.Option(help="Bytes take the time of this baud rate; by default none.")] = None,
    usb_latency: Annotated[
        float, typer.Option(help="With --baud: delay that a USB adapter adds to an answer [ms].")
    ] = 0.0,
    return_delay: Annotated[int, typer.Option(help="Register 9 of every servo [2 µs]; new servos have 250.")] = 0,
    fault: Annotated[list[str] | None, typer.Option(help="Fault to inject, e.g. 'after 2 silent 3'.")] = None,
    strict: Annotated[bool, typer.Option(help="Silent at a wrong baud rate and to frames without stuffing.")] = False,
    control: Annotated[bool, typer.Option(help="Read faults and `state` from stdin.")] = False,
    lockstep: Annotated[
        float | None,
        typer.Option(
            min=10, max=1000, help="Each frame of goals advances time by a tick, at this rate; the clock is ignored."
        ),
    ] = None,
) -> None:
    """Run an emulated bus on a pseudo terminal; prints `ready PATH`, stops on SIGTERM."""
    from robot_retarget.actuators.map import load_map
    from robot_retarget.servo.emulator.run import emulator, scene_of

    if view and not physics:
        raise UsageError("--view needs --physics: without it there is no robot to show")
    if pendulum and physics:
        raise UsageError("--pendulum loads separate motors; with --physics the model is the load")
    servo_map = load_map(map_name)
    body = (model or scene_of(servo_map.robot)) if physics else None
    server = emulator(
        servo_map,
        link,
        _pace(baud, usb_latency),
        body,
        fault or (),
        strict,
        return_delay,
        view,
        lockstep,
        _pendulum(pendulum) if pendulum else None,
    )
    server.run(control)


@servos.command(epilog="Example: robot-retarget servos scan --port /dev/ttyUSB0")
def scan(
    port: Port,
    baud: Annotated[list[int] | None, typer.Option(help="Baud rates to try; the usual ones by default.")] = None,
    last: Annotated[int, typer.Option(min=0, max=252, help="Highest id to try.")] = 252,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find the servos on a port, at every baud rate."""
    from robot_retarget.actuators.control_tables import model_numbered
    from robot_retarget.servo.bus import Bus

    found = []
    for rate in baud or (2_000_000, 1_000_000, 57_600, 3_000_000, 4_000_000, 115_200):
        with Bus(port, rate) as bus:
            for identity, number, firmware in bus.scan(range(last + 1)):
                model = model_numbered(number)
                name = model.name if model else f"model {number}"
                found.append({"id": identity, "model": name, "firmware": firmware, "baud": rate})
        if found:
            break
    if json:
        console.dump(found)
    else:
        console.table("Servos", ("id", "model", "firmware", "baud"), [tuple(row.values()) for row in found])
    if not found:
        raise ServoError(f"no servo answers on {port} (power, cable, --baud)")


@servos.command(epilog="Example: robot-retarget servos check --map op3 --port /dev/ttyUSB0")
def check(
    map_name: MapName,
    port: Port,
    baud: Baud = None,
    fix: Annotated[bool, typer.Option("--fix", help="Write what can be put right, where torque is off.")] = False,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compare the servos with the map; every difference at once. Exit code 1 when playing would be refused."""
    from robot_retarget.actuators.map import load_map
    from robot_retarget.servo.bus import Bus
    from robot_retarget.servo.check import check as ask
    from robot_retarget.servo.check import fix as put_right

    servo_map = load_map(map_name)
    with Bus(port, baud or servo_map.baud) as bus:
        conditions, findings = ask(bus, servo_map)
        done = put_right(bus, servo_map, findings) if fix else []
        if done:
            conditions, findings = ask(bus, servo_map)
    if json:
        rows = {c.servo.joint: {"angle_rad": round(c.angle, 4), **c.values} for c in conditions}
        console.dump({"servos": rows, "findings": [str(f) for f in findings], "fixed": done})
    else:
        for sentence in (*done, *map(str, findings)):
            console.say(sentence)
        console.say(
            f"{len(conditions)} of {len(servo_map.servos)} servos answer as they should; {len(findings)} differences"
        )
    raise typer.Exit(1 if any(f.grave for f in findings) else 0)


@servos.command(epilog="Example: robot-retarget servos calibrate --map op3 --port /dev/ttyUSB0 -o my_op3.toml")
def calibrate(
    map_name: MapName,
    port: Port,
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The map to write (.toml).")],
    baud: Baud = None,
    joint: Annotated[list[str] | None, typer.Option(help="Only these joints.")] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Record where the servos are now as the zero pose: bring the robot there by hand first, torque off."""
    from robot_retarget.actuators.map import load_map, with_zeros
    from robot_retarget.servo.bus import Bus
    from robot_retarget.servo.calibrate import record_zeros

    servo_map = load_map(map_name)
    with Bus(port, baud or servo_map.baud) as bus:
        new = record_zeros(bus, servo_map, joint or servo_map.joints)
    _write(output, with_zeros(map_name, new))
    moved = {b.joint: [a.zero, b.zero] for a, b in zip(servo_map.servos, new.servos, strict=True) if a.zero != b.zero}
    lines = [f"{name}: zero {before} -> {now}" for name, (before, now) in moved.items()]
    console.show_result({"output": str(output), "zeros": moved}, "\n".join([*lines, f"wrote {output}"]), json)


@servos.command(
    epilog="Example: robot-retarget servos identify --map bench.toml --joint j1 --mass 0.3 --length 0.1 --port /dev/ttyUSB0 -o new.toml"
)
def identify(
    map_name: MapName,
    port: Port,
    joint: Annotated[str, typer.Option(help="The joint whose servo turns the pendulum; 0 rad where it hangs.")],
    mass: Annotated[float, typer.Option(help="Of the pendulum [kg].")],
    length: Annotated[float, typer.Option(help="From the axis to its centre of mass [m].")],
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The map to write (.toml).")],
    inertia: Annotated[float, typer.Option(help="About the axis [kg m²]; by default that of a point mass.")] = 0.0,
    log: Annotated[Path, typer.Option(help="The log to write (.npz).")] = Path("identify.npz"),
    baud: Baud = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find a servo's friction, armature, damping and gain: move it with a known pendulum for 24 s, and fit."""
    from robot_retarget.actuators.map import dump_map, load_map
    from robot_retarget.files import require_writable
    from robot_retarget.servo.identify import identify as find
    from robot_retarget.servo.identify import with_identified
    from robot_retarget.servo.pendulum import Pendulum

    servo_map, pendulum = load_map(map_name), Pendulum(mass, length, inertia)
    servo_map = replace(servo_map, baud=baud) if baud else servo_map
    for path in (output, log):
        require_writable(path)
    found = find(servo_map, joint, pendulum, port, log)
    _write(output, dump_map(with_identified(servo_map, joint, found.servo)))
    facts = {**vars(found.servo), "delay_s": round(found.delay, 5), "error_rad": round(found.error, 5)}
    facts |= {"supply_V": round(found.voltage, 2), "weight_factor": round(found.weight, 3)}
    lines = [
        f"{name} {getattr(found.servo, name):g} ± {spread:.2g} {UNITS[name]}".rstrip()
        for name, spread in found.spread.items()
    ]
    lines += [
        f"at {found.voltage:.1f} V; simulated angles are {found.error:.4f} rad off on average, {1000 * found.delay:.1f} ms late"
    ]
    facts["standard_errors"] = {name: float(f"{spread:.3g}") for name, spread in found.spread.items()}
    console.show_result({"output": str(output), **facts}, "\n".join([*lines, f"wrote {output}"]), json)


@servos.command("import", epilog="Example: robot-retarget servos import OP3.robot --offsets offset.yaml -o op3.toml")
def import_map(
    file: Annotated[Path, typer.Argument(help="OP3.robot, lerobot or pypot JSON, ToddlerBot config.json.")],
    output: Annotated[Path, typer.Option("-o", "--out", "--output", help="The map to write (.toml).")],
    offsets: Annotated[Path | None, typer.Option(help="offset.yaml beside an OP3.robot.")] = None,
    model: Annotated[str | None, typer.Option(help="Servo model where the file names none.")] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make a servo map from another project's configuration."""
    from robot_retarget.actuators.map import dump_map
    from robot_retarget.servo.foreign import read_foreign

    servo_map = read_foreign(file, offsets, model)
    _write(output, dump_map(servo_map))
    cut, count = [servo.joint for servo in servo_map.servos if servo.range_exceeds_turn], len(servo_map.servos)
    console.show_result(
        {"output": str(output), "servos": count, "cut": cut},
        f"wrote {output}: {count} servos; look over signs, zeros and ranges before playing",
        json,
    )
    if cut:
        console.note(f"The one turn of position mode cuts the range of {', '.join(cut)}.")


def _pendulum(text: str) -> "Pendulum":
    from robot_retarget.servo.pendulum import Pendulum

    try:
        mass, length = map(float, text.split(","))
    except ValueError:
        raise UsageError(f"--pendulum {text!r} is not MASS,LENGTH, such as 0.3,0.1") from None
    return Pendulum(mass, length)


def _write(path: Path, text: str) -> None:
    from robot_retarget.files import replacing

    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def _pace(baud: int | None, usb_latency: float) -> "WireTiming":
    from robot_retarget.servo.emulator.wire_timing import WireTiming

    if usb_latency and baud is None:
        raise UsageError("--usb-latency needs --baud")
    return WireTiming(baud, usb_latency / 1000)
