"""The datasheet: control tables, model numbers and units of X, MX, AX and XL-320 servos. Behaviour is elsewhere.

Each register is (address, bytes, access, default, lowest, highest); signed where its lowest is negative.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from numbers import Integral
from typing import Any, Literal, NamedTuple

from robot_retarget.actuators.motors import MOTORS, SERVOS, MotorModel, motor_named, read_table
from robot_retarget.base.errors import ServoError

CENTRE = 2048
"""Present position in the middle of a turn [ticks]."""
RPM = 0.1047198
"""A revolution a minute [rad/s]."""
WATCHDOG_UNIT = 0.02
"""Of the register `bus_watchdog` [s]."""
RETURN_DELAY_UNIT = 2e-6
"""Of the register `return_delay_time` [s]."""
BAUDS = {
    1: {207: 9600, 34: 57600, 16: 115200, 3: 500_000, 1: 1_000_000, 0: 2_000_000, 251: 2_500_000, 252: 3_000_000},
    2: dict(enumerate((9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000))),
}
"""By protocol and by the value of the register `baud_rate`: 2,000,000 / (value + 1) under Protocol 1, up to 249."""

VOLTAGE, OVERHEATING, ENCODER, SHOCK, OVERLOAD = 0, 2, 3, 4, 5
HARDWARE_ERRORS = {
    VOLTAGE: "input voltage",
    OVERHEATING: "overheating",
    ENCODER: "encoder",
    SHOCK: "electrical shock",
    OVERLOAD: "overload",
}
"""Bits of `hardware_error_status`."""


class Register(NamedTuple):
    """One line of a control table."""

    address: int
    size: int
    writable: bool
    default: int
    low: int
    high: int
    direction: int = 0
    """The bit that is set in negative values; 0 for two's complements."""

    @property
    def end(self) -> int:
        """The address behind it."""
        return self.address + self.size

    @property
    def signed(self) -> bool:
        return self.low < 0

    def encode(self, value: int) -> bytes:
        """A value as the bytes of this register.

        Raises:
            OverflowError: it does not fit.
        """
        if self.direction:
            return (abs(int(value)) | (value < 0) << self.direction).to_bytes(self.size, "little")
        return int(value).to_bytes(self.size, "little", signed=self.signed or value < 0)

    def checked(self, value: int) -> bytes:
        """As `encode`, of whole numbers of the register's range only.

        Raises:
            ServoError: any other value.
        """
        if not (isinstance(value, Integral) and self.low <= value <= self.high):
            raise ServoError(f"{value!r} is no value of the register at {self.address}: {self.low} to {self.high}")
        return self.encode(value)

    def decode(self, data: bytes) -> int:
        """The value in the bytes of this register."""
        value = int.from_bytes(data[: self.size], "little", signed=self.signed and not self.direction)
        return direct(value, self.direction) if self.direction else value


def direct(value: Any, direction: int) -> Any:
    """Return raw values with the sign of their bit `direction`."""
    return (value & (1 << direction) - 1) * (1 - 2 * (value >> direction & 1))


def _table(name: str) -> dict[str, Register]:
    return {row.pop("name"): Register(**row) for row in read_table(f"{name}.csv")}


XM430_W350, MX_28, AX_12, XL_320 = map(_table, ("xm430_w350", "mx_28", "ax_12", "xl_320"))
"""https://emanual.robotis.com/docs/en/dxl/: x/xm430-w350, mx/mx-28, ax/ax-12a, x/xl320, each #control-table. Registers of one
meaning have the X series' names: `min_position_limit` is the CW angle limit, `profile_velocity` the moving speed and `goal_pwm`
the torque limit."""
TABLES = {"mx1": MX_28, "ax1": AX_12, "xl320": XL_320}
"""Of `Model.table`; all others are like `XM430_W350`."""
INDIRECT = ((168, 224, 28), (578, 634, 28))
"""Blocks of indirect addresses: first address register, first data byte, how many."""
TABLE_END = 662


@dataclass(frozen=True)
class Model:
    """One servo type: model number and control table; `motor` has its torque and speed."""

    name: str
    table: str
    """`xm`, `xl`, `x330` for 5 V and `mx` with the registers of the X series; `mx1` and `ax1` under Protocol 1; `xl320`."""
    current_unit: float
    """[A]; 0 for a servo without current sensing. Of an MX, AX or XL-320 that has the load instead (0.1 %), a part of the stall
    current."""
    number: int
    current_limit: int
    """0 for a servo whose register 126 is the load."""
    velocity_limit: int
    fast_from: int
    """First firmware that knows the fast reads, or under Protocol 1 the bulk read; 0 for none."""
    steps: int
    """Positions of the register `goal_position` in position mode."""

    @property
    def protocol(self) -> Literal[1, 2]:
        """Of its frames."""
        return 1 if self.table in ("mx1", "ax1") else 2

    @property
    def centre(self) -> int:
        """Present position in the middle [ticks]."""
        return self.steps // 2

    @property
    def eeprom_end(self) -> int:
        """Addresses below keep their values without power and are locked while torque is on."""
        return 24 if self.table in TABLES else 64

    @property
    def velocity_unit(self) -> float:
        """Of the register `present_velocity` [rad/s]."""
        return {"mx1": 0.114, "ax1": 0.111, "xl320": 0.111}.get(self.table, 0.229) * RPM

    @property
    def errors(self) -> dict[int, int]:
        """Bit of `hardware_error_status`, or of a status of Protocol 1, by that of the X series."""
        if self.table == "xl320":
            return {OVERLOAD: 0, OVERHEATING: 1, VOLTAGE: 2}
        return {bit: bit for bit in HARDWARE_ERRORS if self.protocol == 2 or bit not in (ENCODER, SHOCK)}

    @property
    def motor(self) -> MotorModel:
        """What turns inside."""
        return MOTORS[self.name]

    @property
    def registers(self) -> dict[str, Register]:
        return _registers(self)

    @property
    def voltage_range(self) -> tuple[int, int]:
        """Lowest and highest voltage limit [0.1 V]."""
        return {"xl": (60, 140), "x330": (31, 70)}.get(self.table, (95, 160))

    @property
    def layout(self) -> "BusLayout":
        """Where a player reads and writes at every tick."""
        return _layout(self)


class BusLayout(NamedTuple):
    """Addresses and sizes [B] of the registers of a tick. All servos of a bus have the same."""

    protocol: Literal[1, 2]
    goal: tuple[int, int]
    reading: tuple[int, int]
    """Position, velocity, and current or load."""
    supply: tuple[int, int]
    """Voltage and temperature."""
    state: tuple[int, int]
    """From `torque_enable` to `hardware_error_status`, if the table has it."""


@cache
def _layout(model: Model) -> BusLayout:
    registers = model.registers

    def span(*names: str) -> tuple[int, int]:
        found = [registers[name] for name in names if name in registers]
        start = min(register.address for register in found)
        return start, max(register.end for register in found) - start

    return BusLayout(
        model.protocol,
        span("goal_position"),
        span("present_position", "present_velocity", "present_current", "present_load"),
        span("present_input_voltage", "present_temperature"),
        span("torque_enable", "hardware_error_status"),
    )


MODELS = {row["name"]: Model(**{f.name: row[f.name] for f in fields(Model)}) for row in SERVOS}


def model_named(name: str) -> Model:
    """A model by its name, as printed on the servo.

    Raises:
        ServoError: unknown model.
    """
    return MODELS[motor_named(name).name]


def model_numbered(number: int) -> Model | None:
    """A model by the number it answers a ping with, or None."""
    return next((model for model in MODELS.values() if model.number == number), None)


@cache
def _registers(model: Model) -> dict[str, Register]:
    table = dict(TABLES.get(model.table, XM430_W350))

    def alter(name: str, **fields: int) -> None:
        table[name] = table[name]._replace(**fields)

    alter("model_number", default=model.number)
    alter("present_input_voltage", default=round(model.motor.voltage * 10))
    if model.table not in TABLES:
        _alter_as_x(model, table, alter)
    if model.table == "mx1" and model.number != 29:
        table["consuming_current"] = Register(68, 2, True, 2048, 0, 4095)
        table["torque_control_mode"] = Register(70, 1, True, 0, 0, 1)
        table["goal_torque"] = Register(71, 2, True, 0, -1023, 1023, 10)
    if model.name == "MX-106":
        table["drive_mode"] = Register(10, 1, True, 0, 0, 3)
    if model.name == "MX-64":
        alter("max_voltage_limit", default=240)
    if model.name == "AX-18":
        alter("temperature_limit", default=75)
        alter("pwm_limit", default=983)
    return table


def _alter_as_x(model: Model, table: dict[str, Register], alter: Callable[..., None]) -> None:
    """Adapt the table of an XM430 to another servo with its layout."""
    low, high = model.voltage_range
    top = model.current_limit
    alter("velocity_limit", default=model.velocity_limit, high=2047)
    alter("goal_velocity", low=-2047, high=2047)
    alter("max_voltage_limit", default=high, low=low, high=high)
    alter("min_voltage_limit", default=low, low=low, high=high)
    alter("position_p_gain", default=model.motor.p_gain)
    alter("position_d_gain", default=model.motor.d_gain)
    alter("current_limit", default=top, high=top)
    alter("goal_current", default=top, low=-top, high=top)
    if not top:
        for name in ("current_limit", "goal_current"):
            del table[name]
        table["present_load"] = table.pop("present_current")
    if model.table == "mx":
        table["acceleration_limit"] = Register(40, 4, True, 32767, 0, 32767)
    if model.name.startswith("XM540"):
        for port in range(3):
            table[f"external_port_mode_{port + 1}"] = Register(56 + port, 1, True, 0, 0, 3)
            table[f"external_port_data_{port + 1}"] = Register(152 + 2 * port, 2, True, 0, 0, 4095)
    if "330-" in model.name:
        table["pwm_slope"] = Register(62, 1, True, 140, 1, 255)
