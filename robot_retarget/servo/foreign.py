"""Servo maps out of other projects' configuration files: OP3.robot, lerobot, pypot, ToddlerBot."""

from collections.abc import Callable
from dataclasses import replace
from math import isfinite, nan, pi, radians
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.actuators.control_tables import CENTRE, MODELS, model_named
from robot_retarget.actuators.map import TICKS_PER_RADIAN, Servo, ServoMap
from robot_retarget.base.errors import ServoError, known
from robot_retarget.base.untrusted.documents import parse_json, read_text
from robot_retarget.base.untrusted.limits import BROKEN

TODDLERBOT = {
    "XM430": "XM430-W210",
    "XC330": "XC330-T288",
    "XC430": "XC430-W240",
    "2XC430": "2XC430-W250",
    "2XL430": "2XL430-W250",
    "XL330": "XL330-M288",
}
"""Full names of the models that its configuration abbreviates."""
OP3 = {"XM-430": "XM430-W350"}
"""What early OP3.robot files call the servos."""


def read_foreign(path: str | Path, offsets: str | Path | None = None, model: str | None = None) -> ServoMap:
    """Read the servo map of another project; its content decides the format.

    Args:
        path: OP3.robot; lerobot calibration JSON; pypot JSON; ToddlerBot's config.json or config_motors.json.
        offsets: the `offset.yaml` [rad] that belongs to an OP3.robot.
        model: servo model for files without one (lerobot); overrides others.

    Raises:
        ServoError: the file cannot be read, or is of another format.
    """
    text = read_text(path, ServoError)
    table = parse_json(text, path, ServoError) if text.lstrip().startswith("{") else None
    try:
        if table is None:
            return _op3(text, _offsets(offsets), Path(path).stem.lower(), model)
        for holds, reader in _READERS:
            if holds(table):
                return reader(table, Path(path).stem, model)
    except (KeyError, AttributeError) as error:
        raise ServoError(f"{path}: an entry lacks {error}") from error
    except BROKEN as error:
        raise ServoError(f"{path}: an entry cannot be read: {error}") from error
    except ServoError as error:
        raise ServoError(f"{path}: {error}") from None
    raise ServoError(f"{path}: neither OP3.robot nor a JSON file of lerobot, pypot or ToddlerBot")


def by_servos(servo_map: ServoMap) -> ServoMap:
    """Return a map whose joint angles are those of the servos: from their middles, in their sense."""
    turned = []
    for servo in servo_map.servos:
        ticks = servo.zero + servo.scale * np.array([servo.lower, servo.upper]) - servo.type.centre
        low, high = sorted((ticks / abs(servo.scale)).tolist())
        turned.append(replace(servo, sign=1, zero=servo.type.centre, lower=low, upper=high))
    return replace(servo_map, servos=tuple(turned))


def _op3(text: str, offsets: dict[str, float], name: str, model: str | None) -> ServoMap:
    """[ device info ]: type | port | id | model | protocol | joint | items. A joint's zero is 2048 + its offset."""
    servos, baud, section = [], 1_000_000, ""
    for line in (line.split("#")[0].strip() for line in text.splitlines()):
        if line.startswith("["):
            section = line.strip("[] ")
        elif line and section == "port info":
            baud = int(line.split("|")[1])
        elif line.startswith("dynamixel") and section == "device info":
            _, _, identity, named, _, joint = (part.strip() for part in line.split("|")[:6])
            zero = CENTRE + round(offsets.get(joint, 0.0) * TICKS_PER_RADIAN)
            servos.append(Servo(joint, int(identity), _model(model or OP3.get(named, named)), zero=zero))
    if not servos:
        raise ServoError("no dynamixel stands under [ device info ]")
    strange = sorted(set(offsets) - {servo.joint for servo in servos})
    if strange:
        raise ServoError(
            f"the offsets name {strange[0]!r}; {known((servo.joint for servo in servos), typed=strange[0])}"
        )
    return ServoMap(name, tuple(servos), baud)


def _lerobot(table: dict[str, Any], name: str, model: str | None) -> ServoMap:
    """drive_mode 1 turns the sense round; the homing offset h moves the middle: raw = 2048 − h reads as 2048."""
    if model is None:
        raise ServoError("lerobot's calibration names no servo model; say it with --model")
    servos = []
    for joint, entry in table.items():
        sign, zero = (-1 if entry["drive_mode"] else 1), CENTRE - int(entry["homing_offset"])
        ends = sorted(sign * (int(entry[k]) - CENTRE) / TICKS_PER_RADIAN for k in ("range_min", "range_max"))
        servos.append(Servo(joint, int(entry["id"]), _model(model), sign, zero, lower=ends[0], upper=ends[1]))
    return ServoMap(name, tuple(servos))


def _pypot(table: dict[str, Any], name: str, model: str | None) -> ServoMap:
    """Degrees; `indirect` turns the sense round, `offset` is the joint's angle away from the servo's middle.

    `angle_limit` is written to the servo unchanged: it limits the angle from the servo's middle, in its sense. The joints of
    Poppy's URDF are in these coordinates: all 25 of its ranges are the limits of `poppy_humanoid.json`.
    """
    servos = []
    for joint, entry in table["motors"].items():
        sign = -1 if entry["orientation"] == "indirect" else 1
        named = _model(model or str(entry["type"]))
        kind = model_named(named)
        offset = radians(float(entry["offset"]))
        zero = kind.centre + round(sign * offset * kind.motor.ticks_per_radian)
        low, high = sorted(sign * radians(float(angle)) - offset for angle in entry["angle_limit"])
        servos.append(Servo(joint, int(entry["id"]), named, sign, zero, lower=low, upper=high))
    return ServoMap(name, tuple(servos))


def _toddlerbot(table: dict[str, Any], name: str, model: str | None) -> ServoMap:
    """`joints` with id, spec, init_pos and limits [rad]. A motor's joint (`_drive`, `_act`) turns with its servo, one to
    one; what gears and rods make of that are other joints of the model, the passive ones."""
    servos, passive = [], []
    for joint, entry in table["joints"].items():
        if entry.get("is_passive", False) or entry.get("type", "dynamixel") != "dynamixel":
            passive.append(joint)
            continue
        low, high = (max(-2 * pi, min(2 * pi, float(entry[end]))) for end in ("lower_limit", "upper_limit"))
        servos.append(_toddlerbot_servo(joint, int(entry["id"]), model or entry["spec"], entry, low, high))
    baud = int(table.get("general", {}).get("dynamixel_baudrate", 2_000_000))
    return ServoMap(name, tuple(servos), baud, passive=tuple(passive))


def _toddlerbot_motors(table: dict[str, Any], name: str, model: str | None) -> ServoMap:
    """`motor` and `init_pos` [rad] of each motor, in the order of their ids from 0; no limits."""
    servos = [
        _toddlerbot_servo(joint, k, model or entry["motor"], entry, -pi, pi)
        for k, (joint, entry) in enumerate(table.items())
    ]
    return ServoMap(name, tuple(servos), 2_000_000)


def _toddlerbot_servo(joint: str, identity: int, spec: str, entry: dict[str, Any], lower: float, upper: float) -> Servo:
    zero = round(float(entry["init_pos"]) * TICKS_PER_RADIAN)
    gain = round(float(entry.get("kp_real", entry.get("kp", 0))))
    return Servo(joint, identity, _model(TODDLERBOT.get(spec, spec)), zero=zero, lower=lower, upper=upper, p_gain=gain)


def _all_have(table: Any, key: str) -> bool:
    return bool(table) and all(isinstance(entry, dict) and key in entry for entry in table.values())


_READERS: tuple[tuple[Callable[[Any], bool], Callable[[dict[str, Any], str, str | None], ServoMap]], ...] = (
    (lambda table: "motors" in table and "controllers" in table, _pypot),
    (lambda table: "joints" in table, _toddlerbot),
    (lambda table: _all_have(table, "homing_offset"), _lerobot),
    (lambda table: _all_have(table, "motor"), _toddlerbot_motors),
)


def _offsets(path: str | Path | None) -> dict[str, float]:
    """The block `offset:` of an offset.yaml: lines `joint: radians`, deeper than its heading."""
    if path is None:
        return {}
    found: dict[str, float] = {}
    inside = False
    for number, line in enumerate(read_text(path, ServoError).splitlines(), 1):
        bare = line.split("#")[0].rstrip()
        if not bare:
            continue
        if not bare[0].isspace():
            inside = bare.partition(":")[0] == "offset"
            continue
        if inside:
            joint, colon, value = bare.strip().partition(":")
            angle = _number(value) if colon else nan
            if not isfinite(angle):
                raise ServoError(f"{path}:{number}: {bare.strip()!r} is no joint with an angle")
            found[joint] = angle
    if not found:
        raise ServoError(f"{path}: no block `offset:` with joints")
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan


def _model(name: str) -> str:
    """The name without what only says how it is plugged."""
    plain = name.strip().upper()
    return next((known_name for known_name in MODELS if plain.startswith(known_name)), plain)
