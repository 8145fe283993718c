"""One servo: the meaning of its registers. The bus reads and writes them; the world sets the time."""

from dataclasses import dataclass

from robot_retarget.actuators.control_tables import (
    OVERHEATING,
    OVERLOAD,
    TABLES,
    VOLTAGE,
    WATCHDOG_UNIT,
    Model,
)
from robot_retarget.servo.emulator.motor import EmulatedMotor, Shaft, drive
from robot_retarget.servo.emulator.registers import (
    GOALS,
    LIMITED,
    POSITION,
    POSITIONS,
    TORQUE_BY_GOAL,
    Registers,
    collect,
    refusal,
    resolved_runs,
    shut_down,
)
from robot_retarget.servo.protocol import CLEAR_MULTI_TURN, Error

# Log of the writes of hosts to a servo.


@dataclass
class WriteLog:
    """Extremes of the writes since the start, for tests and for authors of hosts."""

    goals: int = 0
    lowest_goal: int = 1 << 31
    """Goals [ticks], of which none are written yet: the bounds of their format."""
    highest_goal: int = -(1 << 31)
    """As `lowest_goal`."""
    largest_step: int = 0
    """Between a goal and the present position, at goals with torque on and at torque on [ticks]."""
    settled: float = 0.0
    """When a host last wrote something, or the watchdog last stopped the servo: since then it is left alone [s]."""

    def note(self, goal: int, present: float | None) -> None:
        """Record a goal position and, with torque on, its distance from the present position [ticks].

        Args:
            goal: the goal position.
            present: the present position; None with torque off.
        """
        self.goals += 1
        self.lowest_goal, self.highest_goal = min(self.lowest_goal, goal), max(self.highest_goal, goal)
        if present is not None:
            self.step(goal, present)

    def step(self, goal: int, present: float) -> None:
        """Record the distance from the shaft to a goal."""
        self.largest_step = max(self.largest_step, round(abs(goal - present)))


PRESENT = ("present", "realtime")
"""Registers that are worked out when somebody looks, or at addresses behind them, begin with these."""


class Device:
    """A servo with its motor. The position of the motor is that of its encoder; hosts see it folded and offset."""

    def __init__(self, model: Model) -> None:
        self.model, self.writes = model, WriteLog()
        self.motor, self.registers = EmulatedMotor(model), Registers(model)
        self.shaft = Shaft(self.registers, self.motor)
        self._present = min(r.address for name, r in model.registers.items() if name.startswith(PRESENT))
        self.voltage = model.motor.voltage
        self.now = 0.0
        """Time of the world [s]."""
        self.powered = True
        self.expired = False
        """The bus watchdog has stopped it."""
        self._fed = self._booted = 0.0
        self.boot()

    @property
    def id(self) -> int:
        return self.registers["id"]

    @property
    def torque(self) -> bool:
        return self.registers["torque_enable"] == 1

    @property
    def mode(self) -> int:
        return self.registers["operating_mode"]

    @property
    def hardware(self) -> int:
        """Pending hardware errors."""
        return self.registers["hardware_error_status"]

    # What happens to it

    def boot(self) -> None:
        """Power up: RAM defaults, present position folded to one turn, goal at the present position."""
        registers = self.registers
        registers.reset_ram()
        for goal, limit in LIMITED.items():
            if goal in registers.by_name and goal != "goal_velocity":
                registers[goal] = registers[limit]
        self.expired, self._booted, self._fed = False, self.now, self.now
        self.motor.switch_off()
        self._rebase()
        if registers["startup_configuration"] & 1:
            registers["torque_enable"] = 1

    def place(self, ticks: float) -> None:
        """Turn the shaft by hand to `ticks` as hosts see it; the goal register does not change."""
        self.motor.position, self.motor.velocity = self.shaft.to_encoder(ticks), 0.0

    def fail(self, bit: int) -> None:
        """Raise a hardware error; the servo lets go when `shutdown` says so."""
        bit = self.model.errors.get(bit, -1)
        if bit < 0:
            return
        self.registers["hardware_error_status"] |= 1 << bit
        if self.registers["shutdown"] >> bit & 1 and self.model.table in TABLES:
            self.registers["goal_pwm"] = 0
        elif self.registers["shutdown"] >> bit & 1:
            self._torque(0)

    def feed(self) -> None:
        """Somebody talks on the bus."""
        self._fed = self.now

    def control(self, now: float, dt: float, voltage: float) -> None:
        """Watch over the servo and work out the duty of its motor for the next `dt` [s]."""
        self.now, self.voltage = now, voltage
        self._watch()
        if self.torque:
            drive(self.mode, self.registers, self.shaft, now, dt)
        else:
            self.motor.duty = 0.0

    def _watch(self) -> None:
        """Watchdog, temperature, voltage and load."""
        r = self.registers
        watch = r["bus_watchdog"]
        if self.torque and watch > 0 and not self.expired and self.now - self._fed > watch * WATCHDOG_UNIT:
            self.expired, self.writes.settled = True, self.now
            r["bus_watchdog"] = -1
            self.shaft.set_stationary(self.shaft.present, self.now)
        if self.motor.temperature > r["temperature_limit"]:
            self.fail(OVERHEATING)
        if not r["min_voltage_limit"] <= round(self.voltage * 10) <= r["max_voltage_limit"]:
            self.fail(VOLTAGE)
        if self.torque and self.motor.overloaded:
            self.fail(OVERLOAD)

    # Instructions

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Error code and bytes."""
        if not self.registers.exists(address, length):
            return Error.ACCESS, b""
        end = address + length
        if end > self._present:
            self.publish()
        return Error.NONE, self.registers.read(address, length)

    def publish(self) -> None:
        """Bring the present registers up to date."""
        r = self.registers
        r["realtime_tick"] = int((self.now - self._booted) * 1000) % 32768
        self.shaft.publish(self.now, self.torque)
        r["present_input_voltage"] = round(self.voltage * 10)
        r["present_temperature"] = round(self.motor.temperature)

    def write(self, address: int, data: bytes) -> int:
        """Check every register touched, then write them; the error code."""
        if not self.registers.exists(address, max(len(data), 1)) or not data:
            return Error.ACCESS if data else Error.DATA_LENGTH
        changes: list[tuple[str, int]] = []
        for start, run in resolved_runs(self.registers, address, data):
            error, found = collect(self.registers, start, run)
            if error:
                return error
            changes += found
        for name, value in changes:
            error = refusal(self.registers, name, value, self.expired)
            if error:
                return error
        for name, value in changes:
            self._apply(name, value)
        self.writes.settled = self.now
        return Error.NONE

    def clear(self, params: bytes) -> int:
        """Forget full turns; not while moving."""
        if params != CLEAR_MULTI_TURN:
            return Error.DATA_RANGE
        if self.shaft.moving(self.now, self.torque):
            return Error.RESULT_FAIL
        self._rebase()
        return Error.NONE

    def factory_reset(self, kind: int) -> int:
        """Default values: 0xFF of everything, 0x01 but the id, 0x02 but id and baud rate; then boot."""
        keep = {0xFF: (), 0x01: ("id",), 0x02: ("id", "baud_rate")}.get(kind)
        if keep is None:
            return Error.DATA_RANGE
        self.registers.reset(keep)
        self.boot()
        return Error.NONE

    # Effects of written registers

    def _apply(self, name: str, value: int) -> None:
        r = self.registers
        if name == "torque_enable":
            self._torque(value)
            return
        changed = r[name] != value
        r[name] = value
        if name == "goal_position":
            self.writes.note(value, self.shaft.present if self.torque else None)
            self.shaft.start(value, self.now)
        elif name == "operating_mode" and changed:
            self._change_mode()
        elif name in ("drive_mode", "homing_offset"):
            self._rebase()
        elif name == "bus_watchdog" and value == 0:
            self.expired = False
        # Under Protocol 1 any goal does it: users of MX report so, the manual does not say.
        by_goal = r["drive_mode"] & TORQUE_BY_GOAL or self.model.protocol == 1
        if name == GOALS.get(self.mode) and by_goal and not shut_down(r):
            self._torque(1)

    def _torque(self, value: int) -> None:
        r = self.registers
        if value and not self.torque:
            r["torque_enable"] = 1
            if self.mode == POSITION:
                self.shaft.drop_turns()
            self._fed = self.now
            here = self.shaft.present
            self.shaft.set_stationary(here, self.now)
            if self.mode in POSITIONS:
                self.writes.step(r["goal_position"], here)
                self.shaft.start(r["goal_position"], self.now)
        elif not value:
            r["torque_enable"] = 0
            self.motor.switch_off()

    def _change_mode(self) -> None:
        r = self.registers
        if self.mode in POSITIONS:
            for gain in ("position_p_gain", "position_i_gain", "position_d_gain"):
                r[gain] = r.by_name[gain].default
        r["profile_velocity"] = r["profile_acceleration"] = 0
        for goal in ("goal_pwm", "goal_current"):
            if goal in r.by_name:
                r[goal] = r[LIMITED[goal]]
        self._rebase()

    def _rebase(self) -> None:
        """Fold the position to one turn, and have the goal where the shaft is."""
        self.shaft.drop_turns()
        self.registers["goal_position"] = round(self.shaft.present)
        self.shaft.set_stationary(self.registers["goal_position"], self.now)


def rested(model: Model, identity: int, baud: int, ticks: float | None = None) -> Device:
    """A servo as a robot has it: its own id, the bus' baud rate, no return delay, at a position, torque off."""
    device = Device(model)
    device.registers["id"], device.registers["baud_rate"] = identity, baud
    device.registers["return_delay_time"] = 0
    device.place(model.centre if ticks is None else ticks)
    device.boot()
    return device
