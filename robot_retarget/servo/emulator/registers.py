"""The memory of one servo: bytes by address, names on top, indirect addresses and EEPROM defaults."""

from robot_retarget.actuators.control_tables import INDIRECT, TABLE_END, TABLES, XM430_W350, Model, Register
from robot_retarget.servo.protocol import Error

REBOUND_FROM = 64
"""Indirect addresses reach from here to the end of the table."""


class Registers(dict[str, int]):
    """Values by name, over bytes by address: which addresses exist, without their meaning.

    Registers of the X series that a model lacks have their defaults there by name, without an address.
    """

    def __init__(self, model: Model) -> None:
        super().__init__()
        self.model = model
        self.by_name: dict[str, Register] = model.registers
        self.at: dict[int, tuple[str, Register]] = {
            register.address: (name, register) for name, register in self.by_name.items()
        }
        self.indirect = () if model.table in TABLES else INDIRECT
        end = TABLE_END if self.indirect else max(register.end for register in self.by_name.values())
        self._bytes = bytearray(end)
        self._exists = bytearray(end)
        for register in self.by_name.values():
            self._exists[register.address : register.end] = b"\x01" * register.size
        for first, data, count in self.indirect:
            self._exists[first : first + 2 * count] = b"\x01" * (2 * count)
            self._exists[data : data + count] = b"\x01" * count
        self.reset()

    def reset(self, keep: tuple[str, ...] = ()) -> None:
        """Factory defaults everywhere, but for the registers named."""
        self.update({name: register.default for name, register in XM430_W350.items() if name not in self.by_name})
        kept = {name: self[name] for name in keep}
        for name, register in self.by_name.items():
            self[name] = kept.get(name, register.default)
        self.reset_indirect()

    def reset_ram(self) -> None:
        """Power-up values of everything that is not EEPROM."""
        for name, register in self.by_name.items():
            if register.address >= self.model.eeprom_end:
                self[name] = register.default
        self["hardware_error_status"] = 0
        self.reset_indirect()

    def reset_indirect(self) -> None:
        for first, data, count in self.indirect:
            for k in range(count):
                self._bytes[first + 2 * k : first + 2 * k + 2] = (data + k).to_bytes(2, "little")
                self._bytes[data + k] = 0

    def __setitem__(self, name: str, value: int) -> None:
        register = self.by_name.get(name)
        if register is None:
            super().__setitem__(name, value)
            return
        span = (1 << 8 * register.size) - 1
        data = register.encode(value) if register.direction else (int(value) & span).to_bytes(register.size, "little")
        self._bytes[register.address : register.end] = data
        super().__setitem__(name, register.decode(data))

    def exists(self, address: int, length: int) -> bool:
        """Whether a stretch starts and ends inside the table and has something in it; gaps read as 0."""
        return length > 0 and address + length <= len(self._bytes) and any(self._exists[address : address + length])

    def read(self, address: int, length: int) -> bytes:
        """Bytes as a host sees them: indirect data show what their address points to."""
        out = bytearray(self._bytes[address : address + length])
        for first, data, count in self.indirect:
            for k in range(max(0, data - address), min(length, data + count - address)):
                target = self.target(first, data, address + k)
                if target is not None:
                    out[k] = self._bytes[target]
        return bytes(out)

    def store(self, address: int, data: bytes) -> None:
        """Put bytes where they belong without asking."""
        self._bytes[address : address + len(data)] = data

    def target(self, first: int, data: int, address: int) -> int | None:
        """Where an indirect data byte points, or None where it points to itself."""
        place = first + 2 * (address - data)
        target = int.from_bytes(self._bytes[place : place + 2], "little")
        return None if target == address or not REBOUND_FROM <= target < len(self._bytes) else target

    def redirected(self, address: int) -> int | None:
        """Where a write to this address lands if it is an indirect data byte that points elsewhere."""
        for first, data, count in self.indirect:
            if data <= address < data + count:
                return self.target(first, data, address)
        return None


# Operating modes and drive modes: their numbers, and which goal, gains and limits belong to them.

CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16
REVERSE, TIME_BASED, TORQUE_BY_GOAL = 1, 4, 8
"""Bits of `drive_mode`."""
HOMING_REACH = 1024
"""In position mode a larger homing offset has no effect."""
GOALS = {
    POSITION: "goal_position",
    EXTENDED: "goal_position",
    CURRENT_POSITION: "goal_position",
    VELOCITY: "goal_velocity",
    CURRENT: "goal_current",
    PWM: "goal_pwm",
}
POSITIONS = (POSITION, EXTENDED, CURRENT_POSITION)
"""Modes that control the position; a change to one of them brings back the factory's gains."""
LIMITED = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}


# Resolve a write: byte ranges become registers and values, or an error code.


def resolved_runs(registers: Registers, address: int, data: bytes) -> list[tuple[int, bytes]]:
    """Return the address and the bytes of every contiguous write; indirect addresses are replaced by their targets.

    Args:
        registers: the memory of the servo, with its indirect addresses.
        address: first address of the write.
        data: the bytes of the write.
    """
    found: list[tuple[int, bytearray]] = []
    for k, byte in enumerate(data):
        place = registers.redirected(address + k)
        place = address + k if place is None else place
        if found and found[-1][0] + len(found[-1][1]) == place:
            found[-1][1].append(byte)
        else:
            found.append((place, bytearray((byte,))))
    return [(start, bytes(run)) for start, run in found]


def collect(registers: Registers, start: int, run: bytes) -> tuple[int, list[tuple[str, int]]]:
    """Error code of one stretch, and its registers with their new values."""
    changes: list[tuple[str, int]] = []
    place, end = start, start + len(run)
    while place < end:
        found = registers.at.get(place)
        if found is None:
            error = _plain(registers, place, run[place - start :])
            if error:
                return error, []
            place += 1
            continue
        name, register = found
        if place + register.size > end:
            return Error.DATA_LENGTH, []
        changes.append((name, register.decode(run[place - start :])))
        place += register.size
    return Error.NONE, changes


def refusal(r: Registers, name: str, value: int, expired: bool) -> int:
    """The error code of writing a value to a register, `expired` when the bus watchdog has stopped the servo; or 0."""
    register, mode = r.by_name[name], r["operating_mode"]
    if not register.writable or (register.address < r.model.eeprom_end and r["torque_enable"]):
        return Error.ACCESS
    # An expired watchdog reads −1; hosts may not write that.
    if not (0 if name == "bus_watchdog" else register.low) <= value <= register.high:
        return Error.DATA_RANGE
    # Without a goal current no mode controls it.
    modes = GOALS if "goal_current" in r.by_name else (VELOCITY, POSITION, EXTENDED, PWM)
    if (name == "operating_mode" and value not in modes) or (name in GOALS.values() and expired):
        return Error.DATA_RANGE
    if name in LIMITED and abs(value) > r[LIMITED[name]]:
        return Error.DATA_LIMIT
    if name == "goal_position" and mode == POSITION:
        inside = r["min_position_limit"] <= value <= r["max_position_limit"]
        return Error.NONE if inside else Error.DATA_RANGE
    if name == "torque_enable" and value and shut_down(r) and r.model.protocol == 2:
        return Error.RESULT_FAIL
    return Error.NONE


def shut_down(r: Registers) -> bool:
    """A hardware error that `shutdown` names is pending."""
    return bool(r["hardware_error_status"] & r["shutdown"])


def _plain(registers: Registers, place: int, rest: bytes) -> int:
    """A byte outside the named registers: indirect addresses and data are kept, gaps swallow."""
    for first, data, count in registers.indirect:
        if first <= place < first + 2 * count:
            pair = (place - first) % 2 == 0 and len(rest) > 1
            if pair and not REBOUND_FROM <= rest[0] + 256 * rest[1] < TABLE_END:
                return Error.DATA_RANGE
            registers.store(place, rest[:1])
        if data <= place < data + count:
            registers.store(place, rest[:1])
    inside = any(r.address < place < r.address + r.size for r in registers.by_name.values())
    return Error.DATA_LENGTH if inside else Error.NONE
