"""The servo map (`servos.toml`): the servo of each joint, and the limits of playback.

    ticks = zero + sign · gear · q · 4096 / 2π        (1228.8 / 2π of an AX or XL-320, which has 1024 steps for 300°)

Radians outside, ticks inside the two functions that convert.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from math import pi, tau
from pathlib import Path
from typing import Any, Literal

from robot_retarget.actuators.balance_tables import Balance, Bounds, Imu, MapError, require_bounds, within
from robot_retarget.actuators.control_tables import BAUDS, CENTRE, Model, model_named
from robot_retarget.actuators.motors import TICKS_PER_TURN, MotorModel
from robot_retarget.base.errors import ServoError, known
from robot_retarget.base.files import MODELS as SHIPPED
from robot_retarget.base.untrusted.documents import line_of, parse_toml, read_text

TICKS_PER_RADIAN = TICKS_PER_TURN / tau
"""Of X and MX servos; `Servo.scale` has that of each."""


@dataclass(frozen=True)
class Servo:
    """One joint's servo."""

    joint: str
    id: int = field(metadata=within(0, 252))
    model: str
    sign: int = field(default=1, metadata=within(-1, 1))
    """+1 if joint and servo turn the same way, −1 otherwise."""
    zero: int = field(default=CENTRE, metadata=within(-2 * TICKS_PER_TURN, 2 * TICKS_PER_TURN, "ticks"))
    """Present position of the servo where the joint is at 0 rad."""
    gear: float = field(default=1.0, metadata=within(0.01, 100))
    """Turns of the servo for one turn of the joint."""
    lower: float = field(default=-pi, metadata=within(-4 * pi, 4 * pi, "rad"))
    """[rad]."""
    upper: float = field(default=pi, metadata=within(-4 * pi, 4 * pi, "rad"))
    """[rad]."""
    p_gain: int = field(default=0, metadata=within(0, 16383))
    """Register `position_p_gain`, written before torque is switched on; 0 keeps the factory's."""

    def __post_init__(self) -> None:
        require_bounds(self, f"{self.joint}: ")
        if self.sign == 0:
            raise MapError(f"{self.joint}: sign must be 1 or -1, got 0", "sign")
        if not self.lower < self.upper:
            raise MapError(f"{self.joint}: lower {self.lower:g} is not below upper {self.upper:g}", "lower")
        try:
            model_named(self.model)
        except ServoError as error:
            raise MapError(f"{self.joint}: {error}", "model") from None
        low, high = self.tick_range
        if not low < high:
            last = self.type.steps - 1
            what = f"{self.lower:g} to {self.upper:g} rad is outside the one turn of its servo, 0…{last} ticks"
            raise MapError(f"{self.joint}: {what}; look over zero, sign and gear", "zero")
        gain = self.type.registers.get("position_p_gain")
        if self.p_gain and (gain is None or self.p_gain > gain.high):
            highest = f"at most {gain.high}" if gain else "no p_gain: it has slopes of compliance"
            raise MapError(f"{self.joint}: an {self.type.name} has {highest}, got {self.p_gain}", "p_gain")

    @property
    def type(self) -> Model:
        """The servo's datasheet."""
        return model_named(self.model)

    @property
    def motor(self) -> MotorModel:
        """The motor of the datasheet, at the gain of the map."""
        return replace(self.type.motor, p_gain=self.p_gain or self.type.motor.p_gain)

    def ticks(self, radians: float) -> int:
        """The nearest position of the servo for a joint angle."""
        return self.zero + round(self.scale * radians)

    def radians(self, ticks: float) -> float:
        """The joint angle at a position of the servo."""
        return (ticks - self.zero) / self.scale

    @property
    def scale(self) -> float:
        """Ticks for a radian of the joint, negative where the two turn in opposite directions [1/rad]."""
        return self.sign * self.gear * self.type.motor.ticks_per_radian

    @property
    def tick_range(self) -> tuple[int, int]:
        """Lowest and highest goal position that keeps the joint in its range and the servo in one turn."""
        low, high = self._ends
        return max(low, 0), min(high, self.type.steps - 1)

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest joint angle of a goal: inside the joint's range and the tick range [rad]."""
        low, high = sorted(map(self.radians, self.tick_range))
        return max(low, self.lower), min(high, self.upper)

    @property
    def range_exceeds_turn(self) -> bool:
        """Whether an end of the joint's range lies outside the single turn of the servo."""
        low, high = self._ends
        return low < 0 or high >= self.type.steps

    @property
    def _ends(self) -> tuple[int, int]:
        ends = sorted((self.ticks(self.lower), self.ticks(self.upper)))
        return ends[0], ends[1]


@dataclass(frozen=True)
class Limits:
    """Limits of playback, for any trajectory."""

    speed: float = field(default=4.0, metadata=within(0.05, 60, "rad/s"))
    """Of a goal [rad/s]: 0.83 of the no-load speed of an XM430-W350 in its data sheet."""
    approach_speed: float = field(default=0.8, metadata=within(0.01, 10, "rad/s"))
    """Of the way to the first frame [rad/s]: a fifth of the 4 rad/s of `speed`."""
    approach_time: float = field(default=2.0, metadata=within(0.1, 60, "s"))
    """Its shortest duration [s]."""
    jump: float = field(default=0.5, metadata=within(0.02, 3, "rad"))
    """Between a goal and where the joint is [rad]: twice the 0.23 by which an XM430 that is 57 ms late is behind a goal of 4 rad/s."""
    temperature: float = field(default=70.0, metadata=within(20, 100, "°C"))
    """Hotter servos stop the motion [°C]: 10 K below the shutdown of the data sheet."""
    current: float = field(default=2.0, metadata=within(0.05, 20, "A"))
    """For longer than half a second it stops the motion [A]: 0.87 of the stall current of an XM430 in its data sheet."""
    min_voltage: float = field(default=10.0, metadata=within(3, 30, "V"))
    """[V]: the least input voltage of an XM430 in its data sheet."""
    max_voltage: float = field(default=14.8, metadata=within(3, 30, "V"))
    """[V]: the largest input voltage of an XM430 in its data sheet."""
    watchdog: float = field(default=0.1, metadata=within(0, 2.54, "s"))
    """Time without a message from the host after which the servos stop [s]: twelve ticks at 125 a second."""
    silence: float = field(default=0.1, metadata=within(0.01, 1, "s"))
    """Time without an answer of a servo after which the motion stops [s]: twelve ticks at 125 a second."""

    def __post_init__(self) -> None:
        require_bounds(self)
        if not self.min_voltage < self.max_voltage:
            message = f"min_voltage {self.min_voltage:g} is not below max_voltage {self.max_voltage:g}"
            raise MapError(message, "min_voltage")


@dataclass(frozen=True)
class Identified:
    """Mechanics of one servo model as `servos identify` found them, at the servo's shaft; simulations take them."""

    damping: float = field(metadata=within(0, 100, "N m s/rad"))
    """Besides the back-EMF [N m s/rad]."""
    friction: float = field(metadata=within(0, 100, "N m"))
    """Dry [N m]."""
    armature: float = field(metadata=within(0, 100, "kg m²"))
    """[kg m²]."""
    gain: float = field(default=1.0, metadata=within(0.05, 20))
    """Position gain over that of the datasheet [-]."""
    static: float = field(default=0.0, metadata=within(0, 100, "N m"))
    """More friction at rest [N m]."""
    load: float = field(default=0.0, metadata=within(0, 1))
    """Friction per torque through the gears [-] ..."""
    static_load: float = field(default=0.0, metadata=within(0, 1))
    """... and more of that at rest [-]."""
    rest_speed: float = field(default=1.0, metadata=within(0.001, 100, "rad/s"))
    """Speed at which the friction of rest has fallen to 1/e [rad/s]."""
    rest_shape: float = field(default=1.0, metadata=within(0.1, 20))
    """Exponent of that fall [-]."""

    def __post_init__(self) -> None:
        require_bounds(self)


@dataclass(frozen=True)
class Stop:
    """How a motion ends."""

    pose: Mapping[str, float] = field(default_factory=dict)
    """Joint angles at the end [rad]; other joints do not move."""


@dataclass(frozen=True)
class ServoMap:
    """All servos of a robot on one bus; without servos, the sensor and gains of a robot on its model's actuators."""

    robot: str
    servos: tuple[Servo, ...]
    baud: int = 1_000_000
    """[1/s]: that of the bus in the configuration of the OP3, 1 Mbaud."""
    limits: Limits = field(default_factory=Limits)
    stop: Stop = field(default_factory=Stop)
    passive: tuple[str, ...] = ()
    """Joints of the robot that no servo turns: springs, rods, the far side of gears."""
    imu: Imu | None = None
    """The inertial sensor, where the robot has one."""
    balance: Balance | None = None
    """Gains that turn its readings into goals."""
    identified: Mapping[str, Identified] = field(default_factory=dict)
    """By servo model."""

    def __post_init__(self) -> None:
        if not self.servos and self.balance is None:
            raise ServoError("a servo map needs at least one servo, or [imu] and [balance]")
        rates = BAUDS[self.protocol].values()
        if self.baud not in rates:
            raise MapError(f"baud {self.baud} is not a rate of servos; {known(map(str, rates))}", "baud")
        self._require_one_bus()
        for what, values in (("joint", self.joints), ("id", self.ids)):
            twice = [servo for k, servo in enumerate(self.servos) if values[k] in values[:k]]
            if twice:
                message = f"{what} {getattr(twice[0], what)} stands twice in the map"
                raise MapError(message, "servo", twice[0].joint, what)
        for joint, angle in self.stop.pose.items():
            if joint not in self.joints:
                message = f"[stop] pose names {joint!r}, which has no servo; {known(self.joints, typed=joint)}"
                raise MapError(message, "stop", "pose", joint)
            servo = self[joint]
            Bounds(servo.lower, servo.upper, "rad").require(f"[stop] pose of {joint}", angle, "stop", "pose", joint)
        self._require_sensor()

    def _require_one_bus(self) -> None:
        """All servos have one protocol and layout."""
        for servo in self.servos[1:]:
            first, other = self.servos[0], servo.type.layout
            if other != first.type.layout:
                speaks = first.type.protocol != other.protocol
                why = f"Protocol {first.type.protocol} and Protocol {other.protocol}" if speaks else "other addresses"
                message = (
                    f"{first.joint} ({first.model}) and {servo.joint} ({servo.model}) cannot share a bus: {why}; "
                    "give each kind a port and a map of its own"
                )
                raise MapError(message, "servo", servo.joint, "model")

    def _require_sensor(self) -> None:
        """The sensor and its gains are of this map."""
        if self.balance is not None and self.imu is None:
            raise MapError("[balance] needs an [imu]", "balance")
        if self.servos:
            self.require_gains_of(self.joints)
        if self.imu is not None and self.imu.kind == "opencr":
            if self.protocol == 1:
                raise MapError(
                    "[imu] kind opencr needs Protocol 2; a sensor of kind lines has a port of its own", "imu", "kind"
                )
            if self.imu.id in self.ids:
                raise MapError(f"[imu] has the id {self.imu.id} of a servo", "imu", "id")

    def require_gains_of(self, joints: Sequence[str]) -> None:
        """Check that all gains are of some joints.

        Raises:
            MapError: one is of another joint.
        """
        strange = [joint for joint in (self.balance.joints if self.balance else ()) if joint not in joints]
        if strange:
            message = (
                f"[balance] names {strange[0]!r}, which is not among the joints; {known(joints, typed=strange[0])}"
            )
            raise MapError(message, "balance", "joints", strange[0])

    @property
    def protocol(self) -> Literal[1, 2]:
        """Of the servos' frames."""
        return self.servos[0].type.protocol if self.servos else 2

    @property
    def watchdog(self) -> float:
        """Time without a message after which the servos stop [s]; 0 without a watchdog."""
        return self.limits.watchdog if all("bus_watchdog" in servo.type.registers for servo in self.servos) else 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(servo.joint for servo in self.servos)

    @property
    def ids(self) -> tuple[int, ...]:
        return tuple(servo.id for servo in self.servos)

    @property
    def fingerprint(self) -> str:
        """The sha256 of all that a verdict depends on: robot, joints, models, gears, gains, ranges, speed, step cap, identified servos.

        Ids, signs, zeros and the bus differ between two robots of one kind and are left out.
        """
        servos = sorted(
            (s.joint, s.motor.name, s.motor.p_gain, float(s.gear), float(s.lower), float(s.upper)) for s in self.servos
        )
        identified = sorted((model, *map(float, vars(found).values())) for model, found in self.identified.items())
        rest = [self.robot, servos, float(self.limits.speed), float(self.limits.jump), identified]
        return hashlib.sha256(json.dumps(rest).encode()).hexdigest()

    def __getitem__(self, joint: str) -> Servo:
        found = {servo.joint: servo for servo in self.servos}
        if joint not in found:
            raise ServoError(f"no servo for joint {joint!r}; {known(found, typed=joint)}")
        return found[joint]


def shipped_maps() -> dict[str, Path]:
    """The maps that ship, by robot."""
    return {path.parent.name: path for path in sorted(SHIPPED.glob("*/servos.toml"))}


def load_map(name: str | Path, bare: bool = False) -> ServoMap:
    """Read a servo map: a shipped robot's name, or a TOML file.

    Args:
        bare: accept a map without servos, which has a sensor and gains alone.

    Raises:
        ServoError: the file is missing, has no servos, or has an unknown key or an invalid value.
    """
    path = _map_file(name)
    try:
        text = read_text(path, ServoError)
    except ServoError as error:
        raise ServoError(f"{error}; shipped maps: {', '.join(shipped_maps())}") from error
    table = parse_toml(text, path, ServoError)
    try:
        found = _from_table(table)
        if not (found.servos or bare):
            raise ServoError("it has no servos: its feedback acts in simulation alone")
        return found
    except MapError as error:
        line = line_of(text, error.key)
        raise ServoError(f"{path}:{line}: {error}" if line else f"{path}: {error}") from None
    except ServoError as error:
        raise ServoError(f"{path}: {error}") from None


def _map_file(name: str | Path) -> Path:
    """Return the file of a shipped robot's map, or of a path."""
    return shipped_maps().get(str(name).lower(), Path(name))


def with_zeros(name: str | Path, servo_map: ServoMap) -> str:
    """Return the text of a map's file with the zeros of `servo_map`; its comments and order stay."""
    import tomlkit

    document = tomlkit.parse(read_text(_map_file(name), ServoError))
    tables: Any = document["servo"]
    for before, servo in zip(load_map(name).servos, servo_map.servos, strict=True):
        if servo.zero != before.zero:
            tables[servo.joint]["zero"] = servo.zero
    return tomlkit.dumps(document)


def dump_map(servo_map: ServoMap) -> str:
    """A servo map as TOML; `load_map` reads the same map back."""
    import tomlkit

    table: dict[str, Any] = {"robot": servo_map.robot, "baud": servo_map.baud}
    if servo_map.passive:
        table["passive"] = servo_map.passive
    table["limits"] = vars(servo_map.limits)
    table |= {name: asdict(part) for name in ("imu", "balance") if (part := getattr(servo_map, name)) is not None}
    if servo_map.stop.pose:
        table["stop"] = {"pose": servo_map.stop.pose}
    if servo_map.identified:
        table["identified"] = {model: vars(found) for model, found in servo_map.identified.items()}
    table["servo"] = {
        s.joint: {name: value for name, value in vars(s).items() if name != "joint"} for s in servo_map.servos
    }
    return tomlkit.dumps(table)


def _from_table(table: dict[str, Any]) -> ServoMap:
    _only(table, {"robot", "baud", "passive", "limits", "stop", "servo", "imu", "balance", "identified"}, "the map")
    passive = table.get("passive", [])
    if not (isinstance(passive, list) and all(isinstance(joint, str) for joint in passive)):
        raise MapError(f"the map: passive cannot be {passive!r}, it is a list of joints", "passive")
    robot = table.get("robot", "")
    if not isinstance(robot, str):
        raise MapError(f"the map: robot cannot be {robot!r}, it is a name", "robot")
    servos = [
        _build(Servo, {"joint": joint, **_dict(entry, "servo", joint)}, joint, "servo", joint)
        for joint, entry in _dict(table.get("servo", {}), "servo").items()
    ]
    parts = {
        name: _build(kind, _dict(table[name], name), f"[{name}]", name)
        for name, kind in (("limits", Limits), ("stop", Stop), ("imu", Imu), ("balance", Balance))
        if name in table
    }
    identified = {
        model: _build(Identified, _dict(entry, "identified", model), f"[identified] {model}", "identified", model)
        for model, entry in _dict(table.get("identified", {}), "identified").items()
    }
    baud = table.get("baud", 1_000_000)
    return ServoMap(robot, tuple(servos), baud, passive=tuple(passive), identified=identified, **parts)


def _build(kind: Any, values: dict[str, Any], what: str, *key: str) -> Any:
    """A dataclass from the TOML table at `key`; every key must be one of its fields, of the field's type."""
    types = {f.name: f.type for f in fields(kind)}
    _only(values, set(types), what, *key)
    for name, value in values.items():
        wanted = {"int": (int,), "float": (int, float), "str": (str,), "tuple": (list,)}.get(
            getattr(types[name], "__name__", ""), (dict,)
        )
        if not isinstance(value, wanted) or isinstance(value, bool):
            raise MapError(f"{what}: {name} cannot be {value!r}", *key, name)
    try:
        return kind(**values)
    except TypeError as error:
        raise MapError(f"{what}: {str(error).split('__init__() ')[-1]}", *key) from None
    except MapError as error:
        raise MapError(str(error), *key, *error.key) from None


def _only(values: dict[str, Any], allowed: set[str], what: str, *key: str) -> None:
    strange = sorted(set(values) - allowed)
    if strange:
        raise MapError(f"{what}: no key {strange[0]!r}; {known(sorted(allowed), typed=strange[0])}", *key, strange[0])


def _dict(value: Any, *key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise MapError(f"{'.'.join(key)}: expected a table, got {value!r}", *key)
    return value
