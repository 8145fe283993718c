"""One servo: what its registers mean. Reads and writes come from the bus, time from the world."""

from dataclasses import dataclass, field

from robot_retarget.servo.emulator import profile
from robot_retarget.servo.emulator.modes import (
    CURRENT,
    CURRENT_POSITION,
    EXTENDED,
    GAINS,
    GOALS,
    HOMING_REACH,
    LIMITED,
    POSITION,
    PWM,
    REVERSE,
    TIME_BASED,
    TORQUE_BY_GOAL,
    VELOCITY,
)
from robot_retarget.servo.emulator.motor import Motor
from robot_retarget.servo.emulator.registers import Registers
from robot_retarget.servo.emulator.witness import Witness
from robot_retarget.servo.protocol import ALERT, CLEAR_MULTI_TURN, Error
from robot_retarget.servo.tables import (
    CENTRE,
    EEPROM_END,
    FULL_PWM,
    INDIRECT,
    TICKS_PER_TURN,
    WATCHDOG_UNIT,
    Model,
    Register,
)

PRESENT = range(120, 148)
"""Addresses that are worked out when somebody looks."""


@dataclass
class Device:
    """A servo with its motor. The position of the motor is that of its encoder; hosts see it folded and offset."""

    model: Model
    motor: Motor = field(init=False)
    registers: Registers = field(init=False)
    witness: Witness = field(default_factory=Witness)
    now: float = 0.0
    """Time of the world [s]."""

    def __post_init__(self) -> None:
        self.motor = Motor(self.model)
        self.registers = Registers(self.model)
        self.voltage = self.model.motor.voltage
        self.powered = True
        self._expired = False
        self._fed = self._booted = self._since = 0.0
        self._path = profile.velocity_based(0.0, 0.0, 0, 0)
        self._pending: tuple[int, bytes] | None = None
        self.boot()

    # What others ask of it

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
    def alert(self) -> int:
        """The alert bit, when a hardware error is pending."""
        return ALERT if self.registers["hardware_error_status"] else 0

    def boot(self) -> None:
        """Power-up: RAM defaults, present position folded to one turn, goal where it is."""
        registers = self.registers
        registers.reset_ram()
        registers["backup_ready"] = registers.backup is not None
        for goal, limit in LIMITED.items():
            if goal in registers and goal != "goal_velocity":
                registers[goal] = registers[limit]
        self._expired, self._pending, self._booted, self._fed = False, None, self.now, self.now
        self.motor.rest()
        self._fold()
        self._goal_here()
        if registers["startup_configuration"] & 1:
            registers["torque_enable"] = 1

    def place(self, ticks: float) -> None:
        """Turn the shaft by hand, so that hosts see it at `ticks`; the goal register stays as it is."""
        self.motor.position, self.motor.velocity = self.hidden(ticks), 0.0

    def fail(self, bit: int) -> None:
        """Raise a hardware error; the servo lets go when `shutdown` says so."""
        self.registers["hardware_error_status"] |= 1 << bit
        if self.registers["shutdown"] >> bit & 1:
            self._torque(0)

    def feed(self) -> None:
        """Somebody talks on the bus."""
        self._fed = self.now

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Error code and bytes."""
        if not self.registers.exists(address, length):
            return Error.ACCESS, b""
        end = address + length
        if (address < PRESENT.stop and end > PRESENT.start) or end > INDIRECT[0][1]:
            self.publish()
        return Error.NONE, self.registers.read(address, length)

    def write(self, address: int, data: bytes) -> int:
        """Check every register touched, then write them; the error code."""
        if not self.registers.exists(address, max(len(data), 1)) or not data:
            return Error.ACCESS if data else Error.DATA_LENGTH
        changes: list[tuple[str, int]] = []
        for start, run in self._runs(address, data):
            error = self._collect(start, run, changes)
            if error:
                return error
        for name, value in changes:
            self._apply(name, value)
        return Error.NONE

    def register(self, address: int, data: bytes) -> int:
        """Keep a write for `act`."""
        if not self.registers.exists(address, max(len(data), 1)):
            return Error.ACCESS
        self._pending = (address, data)
        self.registers["registered_instruction"] = 1
        return Error.NONE

    def act(self) -> int:
        """Carry out what was registered."""
        pending, self._pending = self._pending, None
        self.registers["registered_instruction"] = 0
        return self.write(*pending) if pending else Error.NONE

    def clear(self, params: bytes) -> int:
        """Forget full turns; not while moving."""
        if params != CLEAR_MULTI_TURN:
            return Error.DATA_RANGE
        if self._moving():
            return Error.RESULT_FAIL
        self._fold()
        self._goal_here()
        return Error.NONE

    def factory_reset(self, kind: int) -> int:
        """Default values: 0xFF of everything, 0x01 but the id, 0x02 but id and baud rate; then boot."""
        keep = {0xFF: (), 0x01: ("id",), 0x02: ("id", "baud_rate")}.get(kind)
        if keep is None:
            return Error.DATA_RANGE
        self.registers.reset(keep)
        self.boot()
        return Error.NONE

    def store_backup(self, kind: int) -> int:
        """Copy the EEPROM away (1) or bring it back (2); torque must be off."""
        if self.torque or kind not in (1, 2):
            return Error.RESULT_FAIL
        if kind == 1:
            self.registers.save_backup()
            self.registers["backup_ready"] = 1
        elif self.registers.restore_backup():
            self.boot()
        else:
            return Error.RESULT_FAIL
        return Error.NONE

    # What hosts see of the shaft

    def shown(self, ticks: float) -> float:
        """Present position for an encoder position: reversed, then offset."""
        return (TICKS_PER_TURN - ticks if self._reversed else ticks) + self._offset()

    def hidden(self, ticks: float) -> float:
        """Encoder position for a present position."""
        ticks -= self._offset()
        return TICKS_PER_TURN - ticks if self._reversed else ticks

    def publish(self) -> None:
        """Bring the present registers up to date."""
        r, motor = self.registers, self.motor
        sign = -1 if self._reversed else 1
        speed = sign * motor.velocity / profile.VELOCITY
        elapsed = self.now - self._since
        r["realtime_tick"] = int((self.now - self._booted) * 1000) % 32768
        r["present_position"] = round(self.shown(motor.position))
        r["present_velocity"] = round(speed)
        r["present_pwm"] = round(sign * motor.duty * FULL_PWM)
        if "present_current" in r:
            r["present_current"] = round(sign * motor.current / self.model.current_unit)
        else:
            r["present_load"] = round(sign * motor.duty * 1000)
        r["velocity_trajectory"] = round(self._path.velocity(elapsed) / profile.VELOCITY)
        r["position_trajectory"] = round(self._path.position(elapsed))
        r["present_input_voltage"] = round(self.voltage * 10)
        r["present_temperature"] = round(motor.temperature)
        r["moving"] = int(self._moving())
        r["moving_status"] = self._moving_status()

    # Time

    def control(self, now: float, dt: float, voltage: float) -> None:
        """Watch over the servo and work out the duty of its motor for the next `dt` [s]."""
        self.now, self.voltage = now, voltage
        self._guard()
        if not self.torque:
            self.motor.duty = 0.0
            return
        r, motor, mode = self.registers, self.motor, self.mode
        limit = (abs(r["goal_pwm"]) if mode != PWM else r["pwm_limit"]) / FULL_PWM
        sign = -1 if self._reversed else 1
        if mode in GAINS:
            if mode == CURRENT_POSITION:
                limit = min(limit, abs(r["goal_current"]) * self.model.current_unit / self.model.motor.stall_current)
            gains = r["position_p_gain"], r["position_i_gain"], r["position_d_gain"]
            elapsed = now - self._since
            target = self.hidden(self._path.position(elapsed))
            motor.follow(target, sign * self._path.velocity(elapsed), gains, limit, dt)
        elif mode == VELOCITY:
            goal = 0 if self._expired else r["goal_velocity"]
            motor.run(sign * goal * profile.VELOCITY, (r["velocity_p_gain"], r["velocity_i_gain"]), limit, dt)
        elif mode == CURRENT:
            motor.push(0.0 if self._expired else sign * r["goal_current"] * self.model.current_unit, limit)
        else:
            motor.duty = 0.0 if self._expired else sign * max(-limit, min(limit, r["goal_pwm"] / FULL_PWM))

    def _guard(self) -> None:
        """Watchdog, temperature and voltage."""
        r = self.registers
        watch = r["bus_watchdog"]
        if self.torque and watch > 0 and not self._expired and self.now - self._fed > watch * WATCHDOG_UNIT:
            self._expired = True
            r["bus_watchdog"] = -1
            self._start(self.shown(self.motor.position), jump=True)
        if self.motor.temperature > r["temperature_limit"]:
            self.fail(2)
        if not r["min_voltage_limit"] <= round(self.voltage * 10) <= r["max_voltage_limit"]:
            self.fail(0)

    # Writing

    def _runs(self, address: int, data: bytes) -> list[tuple[int, bytes]]:
        """Stretches of bytes at real addresses, indirect data followed to where they point."""
        runs: list[tuple[int, bytearray]] = []
        for k, byte in enumerate(data):
            place = self.registers.redirected(address + k)
            place = address + k if place is None else place
            if runs and runs[-1][0] + len(runs[-1][1]) == place:
                runs[-1][1].append(byte)
            else:
                runs.append((place, bytearray((byte,))))
        return [(start, bytes(run)) for start, run in runs]

    def _collect(self, start: int, run: bytes, changes: list[tuple[str, int]]) -> int:
        """Registers and values of one stretch, or the first error in it."""
        place, end = start, start + len(run)
        while place < end:
            found = self.registers.covering(place)
            if found is None:
                error = self._plain(place, run[place - start :])
                if error:
                    return error
                place += 1
                continue
            name, register = found
            if place + register.size > end:
                return Error.DATA_LENGTH
            value = register.decode(run[place - start :])
            error = self._check(name, register, value)
            if error:
                return error
            changes.append((name, value))
            place += register.size
        return Error.NONE

    def _plain(self, place: int, rest: bytes) -> int:
        """A byte outside the named registers: indirect addresses and data are kept, gaps swallow."""
        for first, data, count in INDIRECT:
            if first <= place < first + 2 * count:
                if (place - first) % 2 == 0 and len(rest) > 1 and not EEPROM_END <= rest[0] + 256 * rest[1] < 662:
                    return Error.DATA_RANGE
                self.registers.store(place, rest[:1])
            if data <= place < data + count:
                self.registers.store(place, rest[:1])
        inside = any(r.address < place < r.address + r.size for r in self.registers.by_name.values())
        return Error.DATA_LENGTH if inside else Error.NONE

    def _check(self, name: str, register: Register, value: int) -> int:
        r = self.registers
        if not register.writable or (register.address < EEPROM_END and self.torque):
            return Error.ACCESS
        low = 0 if name == "bus_watchdog" else register.low
        if not low <= value <= register.high:
            return Error.DATA_RANGE
        if name == "operating_mode" and value not in self._modes():
            return Error.DATA_RANGE
        if name in GOALS.values() and self._expired:
            return Error.DATA_RANGE
        if name in LIMITED and abs(value) > r[LIMITED[name]]:
            return Error.DATA_LIMIT
        if name == "goal_position" and self.mode == POSITION:
            inside = r["min_position_limit"] <= value <= r["max_position_limit"]
            return Error.NONE if inside else Error.DATA_RANGE
        if name == "torque_enable" and value and self._shut_down():
            return Error.RESULT_FAIL
        return Error.NONE

    def _apply(self, name: str, value: int) -> None:
        r = self.registers
        if name == "torque_enable":
            self._torque(value)
            return
        changed = r[name] != value
        r[name] = value
        if name == "goal_position":
            self._note_goal(value)
            self._start(value)
        elif name == "operating_mode" and changed:
            self._change_mode()
        elif name in ("drive_mode", "homing_offset"):
            self._fold()
            self._goal_here()
        elif name == "bus_watchdog" and value == 0:
            self._expired = False
        if name == GOALS.get(self.mode) and r["drive_mode"] & TORQUE_BY_GOAL and not self._shut_down():
            self._torque(1)

    def _torque(self, value: int) -> None:
        r = self.registers
        if value and not self.torque:
            r["torque_enable"] = 1
            if self.mode == POSITION:
                self._fold()
            self._fed = self.now
            here = self.shown(self.motor.position)
            self._path = profile.velocity_based(here, here, 0, 0)
            if self.mode in GAINS:
                self.witness.largest_step = max(self.witness.largest_step, round(abs(r["goal_position"] - here)))
                self._start(r["goal_position"])
        elif not value:
            r["torque_enable"] = 0
            self.motor.rest()

    def _change_mode(self) -> None:
        r = self.registers
        if self.mode in GAINS:
            r["position_p_gain"], r["position_i_gain"], r["position_d_gain"] = GAINS[self.mode]
        r["profile_velocity"] = r["profile_acceleration"] = 0
        for goal in ("goal_pwm", "goal_current"):
            if goal in r:
                r[goal] = r[LIMITED[goal]]
        self._fold()
        self._goal_here()

    def _note_goal(self, value: int) -> None:
        seen = self.witness
        seen.goals += 1
        seen.lowest_goal, seen.highest_goal = min(seen.lowest_goal, value), max(seen.highest_goal, value)
        if self.torque:
            seen.largest_step = max(seen.largest_step, round(abs(value - self.shown(self.motor.position))))

    # Helpers

    @property
    def _reversed(self) -> bool:
        return bool(self.registers["drive_mode"] & REVERSE)

    def _offset(self) -> int:
        offset = self.registers["homing_offset"]
        return 0 if self.mode == POSITION and abs(offset) > HOMING_REACH else offset

    def _modes(self) -> tuple[int, ...]:
        return tuple(GOALS) if "goal_current" in self.registers else (VELOCITY, POSITION, EXTENDED, PWM)

    def _shut_down(self) -> bool:
        return bool(self.registers["hardware_error_status"] & self.registers["shutdown"])

    def _fold(self) -> None:
        self.motor.position %= TICKS_PER_TURN

    def _goal_here(self) -> None:
        self.registers["goal_position"] = round(self.shown(self.motor.position))
        self._start(self.registers["goal_position"], jump=True)

    def _start(self, goal: float, jump: bool = False) -> None:
        """Begin a path from where the present one is to a goal."""
        r, here = self.registers, self._path.position(self.now - self._since)
        speed, ramp = r["profile_velocity"], r["profile_acceleration"]
        if jump:
            self._path = profile.velocity_based(goal, goal, 0, 0)
        elif r["drive_mode"] & TIME_BASED:
            self._path = profile.time_based(here, goal, speed, ramp)
        else:
            self._path = profile.velocity_based(here, goal, speed, ramp)
        self._since = self.now

    def _moving(self) -> bool:
        running = self.torque and self.now - self._since < self._path.total
        return running or abs(self.motor.velocity) > self.registers["moving_threshold"] * profile.VELOCITY

    def _moving_status(self) -> int:
        target = self._path.position(self.now - self._since)
        off = abs(target - self.shown(self.motor.position))
        goal = abs(self.registers["goal_position"] - self.shown(self.motor.position))
        running = self.torque and self.now - self._since < self._path.total
        return (goal < 20) | 2 * running | 8 * (self.torque and off > 100) | (self._path.kind if running else 0)


def rested(model: Model, identity: int, baud: int, ticks: float = CENTRE) -> Device:
    """A servo as a robot has it: its own id, the bus' baud rate, no return delay, at a position, torque off."""
    device = Device(model)
    device.registers["id"], device.registers["baud_rate"] = identity, baud
    device.registers["return_delay_time"] = 0
    device.place(ticks)
    device.boot()
    return device
