"""Compare the servos on the bus with the map."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from robot_retarget.actuators.control_tables import HARDWARE_ERRORS, model_numbered
from robot_retarget.actuators.map import Servo, ServoMap
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.bus import Bus, NoAnswerError, StatusError


@dataclass(frozen=True)
class ServoFinding:
    """One difference or fault of one servo."""

    joint: str
    id: int
    what: str
    grave: bool = True
    """Playing is refused."""
    fix: tuple[str, int] | None = None
    """Register and value that correct it."""

    def __str__(self) -> str:
        return f"{self.joint} (servo {self.id}): {self.what}"


@dataclass(frozen=True)
class Condition:
    """Register values of a servo by name, and its table up to its temperature."""

    servo: Servo
    values: dict[str, int]
    """Under Protocol 1, `hardware_error_status` is that of the answer."""
    table: bytes

    @property
    def angle(self) -> float:
        """Of the joint [rad]."""
        return self.servo.radians(self.values["present_position"])

    def finding(self, what: str, grave: bool = True, fix: tuple[str, int] | None = None) -> ServoFinding:
        """Return a finding about this servo."""
        return ServoFinding(self.servo.joint, self.servo.id, what, grave, fix)


def check(bus: Bus, servo_map: ServoMap) -> tuple[list[Condition], list[ServoFinding]]:
    """Read every servo of a map. Returns all findings, grave ones first."""
    conditions, findings = [], []
    for servo in servo_map.servos:
        condition, found = _ask(bus, servo)
        findings += found
        if condition is not None:
            conditions.append(condition)
            findings += _differences(condition)
            findings += _state(condition, servo_map)
    return conditions, sorted(findings, key=lambda f: not f.grave)


def require_fit(bus: Bus, servo_map: ServoMap) -> tuple[list[Condition], list[str]]:
    """Read every servo of a map. Returns their conditions and sentences on findings that do not forbid playing.

    Raises:
        ServoError: something grave is wrong; the message has the first six grave findings.
    """
    conditions, findings = check(bus, servo_map)
    grave = [str(finding) for finding in findings if finding.grave]
    if grave:
        more = f"; and {len(grave) - 6} more" if len(grave) > 6 else ""
        raise ServoError(f"not fit to be moved: {'; '.join(grave[:6])}{more}")
    return conditions, [str(finding) for finding in findings]


def fix(bus: Bus, servo_map: ServoMap, findings: list[ServoFinding]) -> list[str]:
    """Write the proposed values of the findings where torque is off. Returns a sentence for each."""
    done = []
    for finding in findings:
        if finding.fix is None:
            continue
        name, value = finding.fix
        registers = servo_map[finding.joint].type.registers
        if bus.value(finding.id, registers["torque_enable"]):
            done.append(f"{finding.joint}: torque is on, {name} not written")
            continue
        bus.write(finding.id, registers[name], value)
        done.append(f"{finding.joint}: {name} = {value}")
    return done


def _ask(bus: Bus, servo: Servo) -> tuple[Condition | None, list[ServoFinding]]:
    """Read the registers of one servo after its model is checked."""

    def grave(what: str) -> tuple[None, list[ServoFinding]]:
        return None, [ServoFinding(servo.joint, servo.id, what)]

    answer = bus.ping(servo.id, tries=5)
    if answer is None:
        return grave("does not answer, or garbled (power, cable, baud rate, two servos with one id)")
    number, _ = answer
    if number != servo.type.number:
        other = model_numbered(number)
        return grave(f"is a {other.name if other else f'model {number}'}, the map says {servo.type.name}")
    registers = servo.type.registers
    size = max(registers[name].end for name in ("present_temperature", "hardware_error_status") if name in registers)
    try:
        reply = bus.read(servo.id, 0, size, tries=10)
    except NoAnswerError:
        return grave("answers a ping but garbles its registers: do two servos share this id?")
    except StatusError as error:
        return grave(f"refuses to be read: {error}")
    values = {"hardware_error_status": reply.hardware} if servo.type.protocol == 1 else {}
    values |= {name: r.decode(reply.data[r.address :]) for name, r in registers.items() if r.end <= size}
    return Condition(servo, values, reply.data), []


def _differences(condition: Condition) -> Iterator[ServoFinding]:
    """Yield the EEPROM values that playback does not allow."""
    values, (low, high) = condition.values, condition.servo.tick_range
    for name, wanted, grave in (
        ("operating_mode", 3, True),
        ("control_mode", 2, True),
        ("drive_mode", 0, True),
        ("homing_offset", 0, True),
        ("status_return_level", 2, True),
        ("return_delay_time", 0, False),
    ):
        if values.get(name, wanted) != wanted:
            yield condition.finding(f"{name} is {values[name]}, not {wanted}", grave, (name, wanted))
    lowest, highest = values["min_position_limit"], values["max_position_limit"]
    if lowest >= highest:
        what = f"no position mode: its limits are {lowest} and {highest} (wheel or multi-turn mode)"
        yield condition.finding(what, True, ("max_position_limit", condition.servo.type.steps - 1))
        return
    for name, way, end in (("min_position_limit", "from", low), ("max_position_limit", "to", high)):
        if values[name] > end if way == "from" else values[name] < end:
            yield condition.finding(f"{name} {values[name]} cuts off its range {way} {end}", False, (name, end))


def _state(condition: Condition, servo_map: ServoMap) -> Iterator[ServoFinding]:
    """Yield hardware errors, wrong supply, heat, and a joint outside its range."""
    servo, values, limits = condition.servo, condition.values, servo_map.limits
    bits = values["hardware_error_status"]
    if bits:
        cure = "reboot it" if servo.type.protocol == 2 else "switch its supply off and on"
        yield condition.finding(f"hardware error: {hardware_errors(bits, servo)}; {cure} when the cause is gone")
    volts = values["present_input_voltage"] / 10
    if not limits.min_voltage <= volts <= limits.max_voltage:
        yield condition.finding(f"supply is {volts:.1f} V, allowed {limits.min_voltage:g} to {limits.max_voltage:g} V")
    if values["present_temperature"] >= limits.temperature:
        yield condition.finding(f"is {values['present_temperature']} °C hot, {limits.temperature:g} at most")
    if not servo.lower - 0.05 <= condition.angle <= servo.upper + 0.05:
        what = f"stands at {condition.angle:.2f} rad, outside {servo.lower:.2f} to {servo.upper:.2f}: turn it by hand"
        yield condition.finding(what)


def hardware_errors(bits: int, servo: Servo) -> str:
    """The names of the hardware errors of a servo."""
    own = servo.type.errors
    named = (name for bit, name in HARDWARE_ERRORS.items() if bit in own and bits >> own[bit] & 1)
    return ", ".join(named) or f"bits {bits:#x}"


# The zero pose of a robot, recorded in the map. The servos' homing offsets stay 0: some firmware moves by them.


def record_zeros(bus: Bus, servo_map: ServoMap, joints: Collection[str]) -> ServoMap:
    """A map whose zeros are where the servos of `joints` stand now.

    Raises:
        ServoError: a joint is unknown, a servo is silent, or its torque is on: a pose is set by hand.
    """
    for joint in joints:
        servo_map[joint]
    servos = []
    for servo in servo_map.servos:
        if servo.joint in joints:
            registers = servo.type.registers
            if bus.value(servo.id, registers["torque_enable"]):
                raise ServoError(
                    f"{servo.joint} (servo {servo.id}): torque is on; a zero pose is set by hand, torque off"
                )
            servo = replace(servo, zero=bus.value(servo.id, registers["present_position"]))
        servos.append(servo)
    return replace(servo_map, servos=tuple(servos))
