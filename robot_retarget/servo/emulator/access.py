"""Resolve a write: byte ranges become registers and values, or an error code."""

from robot_retarget.actuators.control_tables import EEPROM_END, INDIRECT, TABLE_END
from robot_retarget.servo.emulator.modes import GOALS, LIMITED, POSITION, allowed_modes
from robot_retarget.servo.emulator.registers import Registers
from robot_retarget.servo.protocol import Error


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
        found = registers.covering(place)
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
    if not register.writable or (register.address < EEPROM_END and r["torque_enable"]):
        return Error.ACCESS
    # An expired watchdog reads −1; hosts may not write that.
    if not (0 if name == "bus_watchdog" else register.low) <= value <= register.high:
        return Error.DATA_RANGE
    if (name == "operating_mode" and value not in allowed_modes(r)) or (name in GOALS.values() and expired):
        return Error.DATA_RANGE
    if name in LIMITED and abs(value) > r[LIMITED[name]]:
        return Error.DATA_LIMIT
    if name == "goal_position" and mode == POSITION:
        inside = r["min_position_limit"] <= value <= r["max_position_limit"]
        return Error.NONE if inside else Error.DATA_RANGE
    if name == "torque_enable" and value and shut_down(r):
        return Error.RESULT_FAIL
    return Error.NONE


def shut_down(r: Registers) -> bool:
    """A hardware error that `shutdown` names is pending."""
    return bool(r["hardware_error_status"] & r["shutdown"])


def _plain(registers: Registers, place: int, rest: bytes) -> int:
    """A byte outside the named registers: indirect addresses and data are kept, gaps swallow."""
    for first, data, count in INDIRECT:
        if first <= place < first + 2 * count:
            pair = (place - first) % 2 == 0 and len(rest) > 1
            if pair and not EEPROM_END <= rest[0] + 256 * rest[1] < TABLE_END:
                return Error.DATA_RANGE
            registers.store(place, rest[:1])
        if data <= place < data + count:
            registers.store(place, rest[:1])
    inside = any(r.address < place < r.address + r.size for r in registers.by_name.values())
    return Error.DATA_LENGTH if inside else Error.NONE
