"""The datasheet: control tables, model numbers and units of the X series. Behaviour is elsewhere.

Each register is (address, bytes, access, default, lowest, highest); signed where its lowest is negative.
"""

import csv
from dataclasses import dataclass
from functools import cache
from numbers import Integral
from pathlib import Path
from typing import NamedTuple

from robot_retarget.actuators.motors import MOTORS, MotorModel, motor_named
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


def _read_table(path: Path) -> dict[str, Register]:
    """Return the registers of a control table by name."""
    with path.open(newline="", encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    numbers = {name: [int(cell) for cell in cells] for name, *cells in rows}
    return {name: Register(at, size, bool(rw), *bounds) for name, (at, size, rw, *bounds) in numbers.items()}


XM430_W350 = _read_table(Path(__file__).with_name("xm430_w350.csv"))
"""https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/#control-table"""
INDIRECT = ((168, 224, 28), (578, 634, 28))
"""Blocks of indirect addresses: first address register, first data byte, how many."""
TABLE_END = 662


@dataclass(frozen=True)
class Model:
    """One servo type: model number and control table; `motor` has its torque and speed."""

    name: str
    number: int
    table: str = "xm"
    """`xm` with current control, `xl` without it (register 126 is the load, 0.1 %), `x330` for 5 V."""
    current_unit: float = 2.69e-3
    """[A]; 0 for a servo without current sensing."""
    current_limit: int = 1193
    velocity_limit: int = 200
    fast_from: int | None = 45
    """First firmware that knows the fast reads, or None."""

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


# https://emanual.robotis.com/docs/en/dxl/x/ : each page's control table
MODELS = {
    model.name: model
    for model in (
        Model("XM430-W350", 1020),
        Model("XM430-W210", 1030, velocity_limit=350),
        Model("XH430-W350", 1000, current_limit=648),
        Model("XH430-W210", 1010, current_limit=648),
        Model("XM540-W270", 1120, current_limit=2047, velocity_limit=128),
        Model("XM540-W150", 1130, current_limit=2047, velocity_limit=230),
        Model("XL430-W250", 1060, table="xl", current_unit=0, velocity_limit=265),
        Model("XC430-W150", 1070, table="xl", current_unit=0, velocity_limit=460),
        Model("XC430-W240", 1080, table="xl", current_unit=0, velocity_limit=306),
        Model("2XL430-W250", 1090, table="xl", current_unit=0, velocity_limit=250, fast_from=None),
        Model("2XC430-W250", 1160, table="xl", current_unit=0, velocity_limit=250, fast_from=None),
        Model(
            "XL330-M077", 1190, table="x330", current_unit=1e-3, current_limit=1750, velocity_limit=1620, fast_from=46
        ),
        Model(
            "XL330-M288", 1200, table="x330", current_unit=1e-3, current_limit=1750, velocity_limit=445, fast_from=46
        ),
        Model("XC330-T288", 1220, table="xm", current_unit=1e-3, current_limit=910, velocity_limit=320, fast_from=46),
        Model(
            "XC330-M288", 1240, table="x330", current_unit=1e-3, current_limit=2352, velocity_limit=350, fast_from=46
        ),
    )
}


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
