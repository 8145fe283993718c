"""The command line of servos: `play`, and the group `servos` (emulate, scan, check, calibrate, import)."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robot_retarget.errors import UsageError

if TYPE_CHECKING:
    from robot_retarget.servo.emulator.pace import Pace

servos_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Dynamixel servos, real or emulated.")

MapName = Annotated[str, typer.Option("--map", "-m", help="A shipped robot's name (op3) or a servo map (.toml).")]


@servos_app.command(epilog="Example: robot-retarget servos emulate --map op3 --physics --link /tmp/ttyDXL")
def emulate(
    map_name: MapName,
    link: Annotated[Path | None, typer.Option(help="A stable name for the port.")] = None,
    physics: Annotated[bool, typer.Option(help="Put the robot's MuJoCo model behind the servos.")] = False,
    model: Annotated[Path | None, typer.Option(help="MJCF for --physics; the shipped robot's by default.")] = None,
    baud: Annotated[int | None, typer.Option(help="Bytes take the time of this baud rate; by default none.")] = None,
    usb_latency: Annotated[float, typer.Option(help="With --baud: what a USB adapter adds to an answer [ms].")] = 0.0,
    return_delay: Annotated[int, typer.Option(help="Register 9 of every servo [2 µs]; new servos have 250.")] = 0,
    fault: Annotated[list[str] | None, typer.Option(help="What goes wrong, e.g. 'after 2 silent 3'.")] = None,
    strict: Annotated[bool, typer.Option(help="Silent at a wrong baud rate and to frames without stuffing.")] = False,
    control: Annotated[bool, typer.Option(help="Read faults and `state` from stdin.")] = False,
) -> None:
    """Run an emulated bus on a pseudo terminal; prints `ready PATH`, stops on SIGTERM."""
    from robot_retarget.servo.emulator.run import emulator, scene_of
    from robot_retarget.servo.map import load_map

    servo_map = load_map(map_name)
    body = (model or scene_of(servo_map.robot)) if physics else None
    server = emulator(servo_map, link, _pace(baud, usb_latency), body, fault or (), strict, return_delay)
    server.run(control)


def _pace(baud: int | None, usb_latency: float) -> "Pace":
    from robot_retarget.servo.emulator.pace import Pace

    if usb_latency and baud is None:
        raise UsageError("--usb-latency needs --baud")
    return Pace(baud, usb_latency / 1000)
