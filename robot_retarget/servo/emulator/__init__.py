"""Put an emulator together from a servo map."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from robot_retarget.actuators.control_tables import BAUDS
from robot_retarget.actuators.inertial import LEVEL, VirtualImu
from robot_retarget.actuators.map import ServoMap
from robot_retarget.actuators.motors import Pendulum
from robot_retarget.base.errors import ServoError
from robot_retarget.base.files import MODELS
from robot_retarget.servo.bus import CODECS
from robot_retarget.servo.emulator.device import rested
from robot_retarget.servo.emulator.network import Board, Network
from robot_retarget.servo.emulator.server import Server, WireTiming
from robot_retarget.servo.emulator.world import World

if TYPE_CHECKING:
    from mujoco import MjSpec

    from robot_retarget.servo.twin import Twin


def emulator(
    servo_map: ServoMap,
    link: Path | None = None,
    timing: WireTiming | None = None,
    physics: "Path | MjSpec | None" = None,
    faults: Sequence[str] = (),
    strict: bool = False,
    return_delay: int = 0,
    view: bool = False,
    lockstep: float | None = None,
    pendulum: Pendulum | None = None,
) -> Server:
    """Return a server with one device per servo of a map, on separate motors or on a robot in MuJoCo.

    Args:
        servo_map: ids, models, zeros and the baud rate.
        link: a stable name for the port.
        timing: the time that bytes take; by default none.
        physics: MJCF of the robot, or its specification.
        faults: sentences of `faults`.
        strict: drop frames without stuffing, and be silent at a wrong baud rate.
        return_delay: register 9 of every servo [2 µs].
        view: show the robot in MuJoCo in a window.
        pendulum: the load of every servo, which then has its published mechanics; without physics.
        lockstep: advance time by one period of this rate per frame of goals instead of the clock [1/s].

    Raises:
        ServoError: the model, a fault, the link or the window is not to be had.
    """
    code = next(code for code, rate in BAUDS[servo_map.protocol].items() if rate == servo_map.baud)
    places = [s.zero if 0 <= s.zero < s.type.steps else s.type.centre for s in servo_map.servos]
    devices = [rested(s.type, s.id, code, place) for s, place in zip(servo_map.servos, places, strict=True)]
    for device, servo in zip(devices, servo_map.servos, strict=True):
        device.registers["return_delay_time"] = return_delay
        if pendulum is not None:
            device.motor.carry(pendulum, servo.gear, servo.zero)
    plant = None
    if physics is not None:
        from robot_retarget.servo.twin import Twin

        plant = Twin(physics, servo_map)
        if view:
            plant.watch()
    world = World(devices, plant)
    for device in devices:
        device.boot()
    server = Server(
        Network(devices, _boards(servo_map, plant), CODECS[servo_map.protocol]),
        world,
        timing or WireTiming(),
        link,
        strict,
        1 / lockstep if lockstep else None,
    )
    for sentence in faults:
        server.faults.add(sentence)
    return server


def _boards(servo_map: ServoMap, plant: "Twin | None") -> list[Board]:
    """The map's sensor, on the robot's trunk or, without physics, on a level table."""
    imu = servo_map.imu
    if imu is None or imu.kind != "opencr":
        return []
    if plant is not None:
        plant.carry(imu)
        return [Board(imu, lambda: plant.reading)]
    still = VirtualImu(imu, imu.delay or 1.0)
    return [Board(imu, lambda: still.read(LEVEL))]


def scene_of(robot: str) -> Path:
    """The scene of a shipped robot: with a floor.

    Raises:
        ServoError: no model ships for the robot.
    """
    for name in ("scene.xml", f"{robot}.xml"):
        if (MODELS / robot / name).is_file():
            return MODELS / robot / name
    raise ServoError(f"no model ships for robot {robot!r}; give one with --model FILE.xml")
