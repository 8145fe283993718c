"""The servo map: which servo moves which joint, and what it must not exceed. `servos.toml` in the robot's folder.

    ticks = zero + sign · gear · q · 4096 / 2π

Radians outside, ticks inside the two functions that convert.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import pi, tau
from pathlib import Path
from typing import Any

from robot_retarget.errors import ServoError, known
from robot_retarget.servo.tables import BAUDS, CENTRE, LAST_POSITION, TICKS_PER_TURN, Model, model_named
from robot_retarget.shipped import MODELS as SHIPPED

TICKS_PER_RADIAN = TICKS_PER_TURN / tau


@dataclass(frozen=True)
class Servo:
    """One joint's servo."""

    joint: str
    id: int
    model: str
    sign: int = 1
    """+1 where the joint's positive sense is the servo's, −1 where it is the other."""
    zero: int = CENTRE
    """Present position of the servo where the joint is at 0 rad."""
    gear: float = 1.0
    """Turns of the servo for one turn of the joint."""
    lower: float = -pi
    """[rad]."""
    upper: float = pi
    """[rad]."""

    def __post_init__(self) -> None:
        if not 0 <= self.id <= 252:
            raise ServoError(f"{self.joint}: id {self.id} is not in 0…252")
        if self.sign not in (-1, 1):
            raise ServoError(f"{self.joint}: sign must be 1 or -1, got {self.sign}")
        if not self.gear > 0:
            raise ServoError(f"{self.joint}: gear must be positive, got {self.gear}")
        if not self.lower < self.upper:
            raise ServoError(f"{self.joint}: lower {self.lower} is not below upper {self.upper}")
        model_named(self.model)

    @property
    def type(self) -> Model:
        """The servo's datasheet."""
        return model_named(self.model)

    def ticks(self, radians: float) -> int:
        """The nearest position of the servo for a joint angle."""
        return self.zero + round(self.sign * self.gear * radians * TICKS_PER_RADIAN)

    def radians(self, ticks: float) -> float:
        """The joint angle at a position of the servo."""
        return (ticks - self.zero) / (self.sign * self.gear * TICKS_PER_RADIAN)

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest goal position that keeps the joint in its range and the servo in one turn."""
        low, high = self._ends
        return max(low, 0), min(high, LAST_POSITION)

    @property
    def cut(self) -> bool:
        """Whether the turn of the servo ends before the joint's range."""
        low, high = self._ends
        return low < 0 or high > LAST_POSITION

    @property
    def _ends(self) -> tuple[int, int]:
        ends = sorted((self.ticks(self.lower), self.ticks(self.upper)))
        return ends[0], ends[1]


@dataclass(frozen=True)
class Limits:
    """What playback must not exceed, whatever the trajectory says."""

    speed: float = 4.0
    """Of a goal [rad/s]."""
    approach_speed: float = 0.8
    """Of the way to the first frame [rad/s]."""
    approach_time: float = 2.0
    """It takes at least so long [s]."""
    jump: float = 0.5
    """Between a goal and where the joint is [rad]."""
    temperature: float = 70.0
    """Hotter servos stop the motion [°C]."""
    current: float = 2.0
    """For longer than half a second it stops the motion [A]."""
    min_voltage: float = 10.0
    """[V]."""
    max_voltage: float = 14.8
    """[V]."""
    watchdog: float = 0.1
    """The servos stop by themselves after so long without a word from the host [s]."""
    silence: float = 0.1
    """A servo that does not answer for so long stops the motion [s]."""


@dataclass(frozen=True)
class Stop:
    """How a motion ends."""

    pose: Mapping[str, float] = field(default_factory=dict)
    """Joint angles [rad] to go to softly before holding; joints not named stay where they are."""


@dataclass(frozen=True)
class ServoMap:
    """All servos of a robot on one bus."""

    robot: str
    servos: tuple[Servo, ...]
    baud: int = 1_000_000
    limits: Limits = field(default_factory=Limits)
    stop: Stop = field(default_factory=Stop)
    passive: tuple[str, ...] = ()
    """Joints of the robot that no servo turns: springs, rods, the far side of gears."""

    def __post_init__(self) -> None:
        if not self.servos:
            raise ServoError("a servo map needs at least one servo")
        if self.baud not in BAUDS:
            raise ServoError(f"baud {self.baud} is none of a servo's; {known(map(str, BAUDS))}")
        for what, values in (("joint", self.joints), ("id", self.ids)):
            twice = sorted({str(v) for v in values if list(values).count(v) > 1})
            if twice:
                raise ServoError(f"{what} {twice[0]} stands twice in the map")
        strange = sorted(set(self.stop.pose) - set(self.joints))
        if strange:
            raise ServoError(f"[stop] pose names {strange[0]!r}, which has no servo; {known(self.joints)}")

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(servo.joint for servo in self.servos)

    @property
    def ids(self) -> tuple[int, ...]:
        return tuple(servo.id for servo in self.servos)

    def __getitem__(self, joint: str) -> Servo:
        found = {servo.joint: servo for servo in self.servos}
        if joint not in found:
            raise ServoError(f"no servo for joint {joint!r}; {known(found)}")
        return found[joint]


def shipped_maps() -> dict[str, Path]:
    """The maps that ship, by robot."""
    return {path.parent.name: path for path in sorted(SHIPPED.glob("*/servos.toml"))}


def load_map(name: str | Path) -> ServoMap:
    """Read a servo map: a shipped robot's name, or a TOML file.

    Raises:
        ServoError: there is no such file, or it has a key or value that means nothing here.
    """
    path = shipped_maps().get(str(name), Path(name))
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        reason = error.strerror or error
        raise ServoError(f"cannot read the servo map {name}: {reason}; shipped: {', '.join(shipped_maps())}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ServoError(f"{path}: {error}") from error
    try:
        return _from_table(table)
    except ServoError as error:
        raise ServoError(f"{path}: {error}") from None


def dump_map(servo_map: ServoMap) -> str:
    """A servo map as TOML; `load_map` reads the same map back."""
    lines = [f'robot = "{servo_map.robot}"', f"baud = {servo_map.baud}"]
    if servo_map.passive:
        lines += [f"passive = [{', '.join(map(_toml, servo_map.passive))}]"]
    lines += ["", "[limits]"]
    lines += [f"{f.name} = {getattr(servo_map.limits, f.name)!r}" for f in fields(Limits)]
    if servo_map.stop.pose:
        lines += ["", "[stop.pose]", *(f'"{joint}" = {angle!r}' for joint, angle in servo_map.stop.pose.items())]
    for servo in servo_map.servos:
        lines += ["", f'[servo."{servo.joint}"]']
        lines += [f"{f.name} = {_toml(getattr(servo, f.name))}" for f in fields(Servo) if f.name != "joint"]
    return "\n".join(lines) + "\n"


def _from_table(table: dict[str, Any]) -> ServoMap:
    _only(table, {"robot", "baud", "passive", "limits", "stop", "servo"}, "the map")
    passive = table.get("passive", [])
    if not (isinstance(passive, list) and all(isinstance(joint, str) for joint in passive)):
        raise ServoError(f"the map: passive cannot be {passive!r}, it is a list of joints")
    servos = [
        _build(Servo, {"joint": joint, **_dict(entry, joint)}, joint) for joint, entry in table.get("servo", {}).items()
    ]
    limits = _build(Limits, _dict(table.get("limits", {}), "[limits]"), "[limits]")
    stop = _build(Stop, _dict(table.get("stop", {}), "[stop]"), "[stop]")
    robot, baud = str(table.get("robot", "")), int(table.get("baud", 1_000_000))
    return ServoMap(robot, tuple(servos), baud, limits, stop, tuple(passive))


def _build(kind: Any, values: dict[str, Any], where: str) -> Any:
    """A dataclass from a TOML table; every key must be one of its fields, of the field's type."""
    types = {f.name: f.type for f in fields(kind)}
    _only(values, set(types), where)
    for key, value in values.items():
        wanted = {"int": (int,), "float": (int, float), "str": (str,)}.get(getattr(types[key], "__name__", ""), (dict,))
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise ServoError(f"{where}: {key} cannot be {value!r}")
    try:
        return kind(**values)
    except TypeError as error:
        raise ServoError(f"{where}: {str(error).split('__init__() ')[-1]}") from None


def _only(values: dict[str, Any], allowed: set[str], where: str) -> None:
    strange = sorted(set(values) - allowed)
    if strange:
        raise ServoError(f"{where}: no key {strange[0]!r}; {known(sorted(allowed))}")


def _dict(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ServoError(f"{where}: expected a table, got {value!r}")
    return value


def _toml(value: Any) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)
