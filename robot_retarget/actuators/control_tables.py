"""The datasheet: control tables, model numbers and units of the X series. Behaviour is elsewhere.

Each register is (address, bytes, access, default, lowest, highest); signed where its lowest is negative.
"""

from dataclasses import dataclass, fields
from functools import cache
from numbers import Integral
from typing import NamedTuple

from robot_retarget.actuators.motors import MOTORS, SERVOS, MotorModel, motor_named, read_table
from robot_retarget.base.errors import ServoError

CENTRE = 2048
"""Present position in the middle of a turn [ticks]."""
LAST_POSITION = 4095
"""Of one turn, as position mode has it."""
VELOCITY_UNIT = 0.0239808
"""[rad/s]: 0.229 revolutions a minute."""
WATCHDOG_UNIT = 0.02
"""Of the register `bus_watchdog` [s]."""
RETURN_DELAY_UNIT = 2e-6
"""Of the register `return_delay_time` [s]."""
BAUDS = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""By the value of the register `baud_rate`."""
EEPROM_END = 64
"""Addresses below keep their values without power and are locked while torque is on."""

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

    @property
    def signed(self) -> bool:
        return self.low < 0

    def encode(self, value: int) -> bytes:
        """A value as the bytes of this register; negative values as two's complement.

        Raises:
            OverflowError: it does not fit.
        """
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
        return int.from_bytes(data[: self.size], "little", signed=self.signed)


XM430_W350 = {row.pop("name"): Register(**row) for row in read_table("xm430_w350.csv")}
"""https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/#control-table"""
INDIRECT = ((168, 224, 28), (578, 634, 28))
"""Blocks of indirect addresses: first address register, first data byte, how many."""
TABLE_END = 662


@dataclass(frozen=True)
class Model:
    """One servo type: model number and control table; `motor` has its torque and speed."""

    name: str
    table: str
    """`xm` with current control, `xl` without it (register 126 is the load, 0.1 %), `x330` for 5 V."""
    current_unit: float
    """[A]; 0 for a servo without current sensing."""
    number: int
    current_limit: int
    velocity_limit: int
    fast_from: int
    """First firmware that knows the fast reads; 0 for none."""

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
        return {"xm": (95, 160), "xl": (60, 140), "x330": (31, 70)}[self.table]


MODELS = {row["name"]: Model(**{f.name: row[f.name] for f in fields(Model)}) for row in SERVOS}


def model_named(name: str) -> Model:
    """A model by its name, as printed on the servo; a trailing -R or -T (its connector) is ignored.

    Raises:
        ServoError: unknown model.
    """
    return MODELS[motor_named(name).name]


def model_numbered(number: int) -> Model | None:
    """A model by the number it answers a ping with, or None."""
    return next((model for model in MODELS.values() if model.number == number), None)


@cache
def _registers(model: Model) -> dict[str, Register]:
    table = dict(XM430_W350)
    low, high = model.voltage_range
    top = model.current_limit

    def alter(name: str, **fields: int) -> None:
        table[name] = table[name]._replace(**fields)

    alter("model_number", default=model.number)
    alter("velocity_limit", default=model.velocity_limit, high=2047)
    alter("goal_velocity", low=-2047, high=2047)
    alter("max_voltage_limit", default=high, low=low, high=high)
    alter("min_voltage_limit", default=low, low=low, high=high)
    alter("present_input_voltage", default=round(model.motor.voltage * 10))
    alter("position_p_gain", default=model.motor.p_gain)
    alter("position_d_gain", default=model.motor.d_gain)
    alter("current_limit", default=top, high=top)
    alter("goal_current", default=top, low=-top, high=top)
    if model.table == "xl":
        for name in ("current_limit", "goal_current"):
            del table[name]
        table["present_load"] = table.pop("present_current")
    if model.name.startswith("XM540"):
        for port in range(3):
            table[f"external_port_mode_{port + 1}"] = Register(56 + port, 1, True, 0, 0, 3)
            table[f"external_port_data_{port + 1}"] = Register(152 + 2 * port, 2, True, 0, 0, 4095)
    if "330-" in model.name:
        table["pwm_slope"] = Register(62, 1, True, 140, 1, 255)
    return table
