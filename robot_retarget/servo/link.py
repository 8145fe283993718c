"""All servos of a map as arrays: goals, readings, and the age of lost readings."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_retarget.actuators.control_tables import WATCHDOG_UNIT, Register, direct
from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.map import ServoMap
from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.servo.bus import PATIENCE, Bus
from robot_retarget.servo.check import Condition
from robot_retarget.servo.outcome import FaultError
from robot_retarget.servo.protocol import ALERT, BROADCAST, Instruction

# Ticks and radians of all servos at once.


class JointScale:
    """Converts between joint angles and servo positions, in the order of the map."""

    low: Floats
    high: Floats
    lower: Any
    upper: Any

    def __init__(self, servo_map: ServoMap) -> None:
        self.joints: tuple[str, ...] = servo_map.joints
        self.ids: NDArray[np.uint8] = np.array(servo_map.ids, dtype=np.uint8)
        self._zero = np.array([s.zero for s in servo_map.servos], dtype=float)
        self._scale = np.array([s.scale for s in servo_map.servos])
        self.tick: Floats = 1 / np.abs(self._scale)
        """(n,) angle of the joint per tick [rad]."""
        ranges = np.array([s.tick_range for s in servo_map.servos])
        self.low, self.high = ranges[:, 0], ranges[:, 1]
        """(n,) lowest and highest goal [ticks]."""
        self.lower, self.upper = np.array([s.reach for s in servo_map.servos]).T
        """(n,) lowest and highest goal [rad]."""

    def ticks(self, radians: Floats) -> Ints:
        """The nearest positions (n,) inside the range.

        Raises:
            FaultError: an angle is no finite number; says whose.
        """
        finite = np.isfinite(radians)
        if not finite.all():
            k = int(np.argmin(finite))
            raise FaultError(f"the goal of {self.joints[k]} (servo {self.ids[k]}) is {radians[k]}: not sent")
        exact = np.rint(self._zero + self._scale * np.minimum(np.maximum(radians, self.lower), self.upper))
        return np.minimum(np.maximum(exact, self.low), self.high).astype(np.int64)

    def radians(self, ticks: Ints | Floats) -> Floats:
        """The joint angles (n,) at positions of the servos."""
        return (ticks - self._zero) / self._scale


# The last look at goals before the wire, whoever made them: this is the only place that lets one through.


class Gate:
    """Lets through whole ticks inside their servos' ranges that are no further from the shafts than the step cap."""

    def __init__(self, servo_map: ServoMap, scale: JointScale) -> None:
        self._map, self._scale = servo_map, scale
        self._cap = np.floor(servo_map.limits.jump / scale.tick)

    def allowed(self, ticks: Ints, present: Ints) -> NDArray[np.bool_]:
        """(n,) which of the goals [ticks] may go to servos whose shafts are at `present` [ticks]; no number may not."""
        whole = np.equal(ticks, np.rint(ticks))
        inside = (self._scale.low <= ticks) & (ticks <= self._scale.high)
        return whole & inside & (np.abs(np.subtract(ticks, present, dtype=float)) <= self._cap)

    def require(self, ticks: Ints, present: Ints) -> None:
        """Check that all goals may go out.

        Raises:
            FaultError: one may not; says whose.
        """
        allowed = self.allowed(ticks, present)
        if not allowed.all():
            k = int(np.argmin(allowed))
            servo, cap = self._map.servos[k], self._map.limits.jump
            low, high = servo.tick_range
            where = f"goal {ticks[k]}, shaft at {present[k]} ticks"
            what = f"no whole tick of {low}…{high} within {cap:g} rad of its shaft ({where})"
            raise FaultError(f"{servo.joint} (servo {servo.id}) was to be sent {what}: not sent")


CYCLE_PATIENCE = 0.75 / RATE
"""Timeout of an answer within a tick, beyond its time on the wire [s]: three quarters of a tick."""


class ServoGoals(NamedTuple):
    """One goal for every servo, and the frame that carries them."""

    ticks: Ints
    """(n,)."""
    frame: bytes


class Link:
    """The servos of one map on a bus, as seen by the player."""

    def __init__(
        self,
        bus: Bus,
        servo_map: ServoMap,
        conditions: list[Condition],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.bus, self.map, self.scale = bus, servo_map, JointScale(servo_map)
        self.gate: Gate = Gate(servo_map, self.scale)
        self.ids: list[int] = list(servo_map.ids)
        self._layout, self._registers = servo_map.servos[0].type.layout, servo_map.servos[0].type.registers
        starts = [s.type.fast_from for s in servo_map.servos]
        answers = zip(self.ids, starts, conditions, strict=True)
        self._chained = [i for i, start, c in answers if c.values["firmware_version"] >= start > 0]
        self.fast: bool = len(self._chained) == len(self.ids) or (self._layout.protocol == 1 and bool(self._chained))
        sign = np.array([s.sign for s in servo_map.servos])
        self._current_unit = sign * [s.type.current_unit for s in servo_map.servos]
        self._velocity_unit = sign * [s.type.velocity_unit / s.gear for s in servo_map.servos]
        start, size = self._layout.reading
        self._raw = bytearray(b"".join(c.table[start : start + size] for c in conditions))
        self._rows = np.frombuffer(self._raw, dtype=_dtype(self._registers, start, size))
        self.present: Floats = np.array([c.angle for c in conditions])
        self.error: Ints = np.zeros(len(self.ids), dtype=np.int64)
        self.voltage: Floats = np.array([c.values["present_input_voltage"] / 10 for c in conditions])
        self.temperature: Floats = np.array([float(c.values["present_temperature"]) for c in conditions])
        self.torque: Bools = np.array([bool(c.values["torque_enable"]) for c in conditions])
        """(n,) whether torque is on, as last read or written."""
        self.hardware: Ints = np.zeros(len(self.ids), dtype=np.int64)
        """(n,) `hardware_error_status`, as last read."""
        self.limp: Bools = np.zeros(len(self.ids), dtype=bool)
        """(n,) joints that are moved by hand: they get no goals."""
        self.alerted: Ints = np.zeros(len(self.ids), dtype=np.int64)
        """(n,) hardware errors in the last answers."""
        self._clock = clock
        self._heard = np.full(len(self.ids), clock())
        self._missed = np.zeros(len(self.ids), dtype=np.int64)
        self._place = {identity: k for k, identity in enumerate(self.ids)}
        self._turn = self._short = 0
        goal, number = self._layout.goal, bus.codec.number
        self._goals = number(goal[0]) + number(goal[1])
        self._table = np.zeros(len(self.ids), dtype=[("id", "u1"), ("goal", f"<i{goal[1]}")])
        self._table["id"] = self.ids
        self._questions = [bus.codec.questions(start, size, self.ids, chain) for chain in ((), self._chained)]

    @property
    def velocity(self) -> Floats:
        """(n,) of the joints [rad/s]."""
        return self._signed("present_velocity") * self._velocity_unit

    @property
    def current(self) -> Floats:
        """(n,) [A]; of a servo that measures none, its load as a part of the stall current."""
        name = "present_current" if "present_current" in self._registers else "present_load"
        return self._signed(name) * self._current_unit

    def _signed(self, name: str) -> Ints:
        """(n,) values of a register as last read."""
        direction, raw = self._registers[name].direction, self._rows[name].astype(np.int64)
        return direct(raw, direction) if direction else raw

    @property
    def age(self) -> Floats:
        """(n,) since each servo's reading [s]; 0 for those of this tick."""
        return np.where(self._missed > 0, self._clock() - self._heard, 0.0)

    @property
    def missed(self) -> np.ndarray:
        """(n,) ticks in a row without an answer."""
        return self._missed

    @property
    def position(self) -> Ints:
        """(n,) the latest present positions [ticks]."""
        return self._rows["present_position"].astype(np.int64)

    def goals(self, goal: Floats) -> ServoGoals:
        """Goals [rad], ready to be sent.

        Raises:
            FaultError: one is no finite number.
        """
        ticks = self.scale.ticks(goal)
        self._table["goal"] = ticks
        return ServoGoals(ticks, self._goal_frame(self._table[~self.limp]))

    def command(self, goal: Floats, which: Bools | None = None) -> None:
        """Send goals [rad] that pass the gate to `which` servos (n,), all by default; other servos keep theirs."""
        ticks, position = self.scale.ticks(np.where(np.isfinite(goal), goal, self.present)), self.position
        self._table["goal"] = ticks
        passed = self.gate.allowed(ticks, position)
        allowed = self._table[~self.limp & (passed if which is None else passed & which)]
        if allowed.size:
            self.bus.send(self._goal_frame(allowed))

    def exchange(self, goals: ServoGoals) -> None:
        """Send goals and ask for readings in one go: a single transfer for a USB adapter.

        Raises:
            FaultError: a goal may not be sent; none is.
        """
        ticks, position = goals.ticks, self.position
        if self.limp.any():
            ticks, position = (np.where(self.limp, self.scale.low, of) for of in (ticks, position))
        self.gate.require(ticks, position)
        self.bus.send(goals.frame + self._questions[self.fast][0].frame)

    def _goal_frame(self, table: np.ndarray) -> bytes:
        if not table.size:
            return b""
        return self.bus.codec.frame(BROADCAST, Instruction.SYNC_WRITE, self._goals + table.tobytes())

    def write_verified(self, goals: ServoGoals, k: int) -> bool:
        """Write one servo's goal and read it back. Returns whether they agree.

        Raises:
            FaultError: a goal may not be sent; none is.
        """
        self.gate.require(goals.ticks, self.position)
        servo, goal = self.map.servos[k], int(goals.ticks[k])
        register = servo.type.registers["goal_position"]
        self.bus.write(servo.id, register, goal)
        return self.bus.value(servo.id, register) == goal

    def set_all(self, name: str, value: int) -> None:
        """Write one value to a RAM register of all servos that have it, without confirmation."""
        having = [servo for servo in self.map.servos if name in servo.type.registers]
        if having:
            register = having[0].type.registers[name]
            data = register.checked(value)
            self.bus.send(self.bus.codec.sync_write(register.address, register.size, ((s.id, data) for s in having)))

    def watchdog(self, seconds: float) -> None:
        """Set the time without a message after which the servos stop [s]; 0 for never. Protocol 1 has no watchdog."""
        self.set_all("bus_watchdog", 0)
        if seconds:
            self.set_all("bus_watchdog", max(1, min(127, round(seconds / WATCHDOG_UNIT))))

    def read(self) -> None:
        """Request readings and receive them with a long timeout."""
        self.bus.send(self._questions[self.fast][0].frame)
        self.listen(PATIENCE)

    def listen(self, patience: float = CYCLE_PATIENCE) -> None:
        """Receive the requested readings; lost ones keep their value, and their age grows."""
        size, goals = self._layout.reading[1], len(self.ids) * self._table.itemsize
        self._missed += 1
        for turn, question in enumerate(self._questions[self.fast]):
            if turn:
                self.bus.send(question.frame)
            for reply in self.bus.replies(question, size, len(question.frame) + (0 if turn else goals), patience):
                k = self._place[reply.id]
                # Each answer is stored on arrival, before the next one.
                self._raw[k * size : (k + 1) * size] = reply.data
                self.error[k] = reply.error | (ALERT if reply.hardware else 0)
                self.alerted[k] = reply.hardware
                self._missed[k] = 0
                self._heard[k] = self._clock()
        # A break in the chain of a fast read loses all servos behind it: two in a row are enough.
        self._short = self._short + 1 if self._missed.any() else 0
        self.fast &= self._short < 2
        self.present = self.scale.radians(self._rows["present_position"])

    def read_slow_registers(self, count: int = 1) -> None:
        """Read slow registers of the next `count` servos: supply and state of all servos in turn."""
        round_of_state, first = divmod(self._turn, len(self.ids))
        places = range(first, min(first + count, len(self.ids)))
        self._turn = (self._turn + len(places)) % (2 * len(self.ids))
        if round_of_state:
            self.read_state(places)
            return
        voltage, temperature = (self._registers[f"present_{name}"] for name in ("input_voltage", "temperature"))
        start = self._layout.supply[0]
        for k, data in self._slow(self._layout.supply, places):
            self.voltage[k] = voltage.decode(data[voltage.address - start :]) / 10
            self.temperature[k] = temperature.decode(data[temperature.address - start :])

    def read_state(self, places: Sequence[int]) -> None:
        """Read torque enable and hardware errors of the servos at `places` of the map."""
        for k, data in self._slow(self._layout.state, places):
            self.torque[k] = bool(data[0])
            self.hardware[k] = data[-1] if len(data) > 1 else self.alerted[k]

    def hardware_bits(self, k: int) -> int:
        """Return the hardware errors of one servo: from its register, or under Protocol 1 from its last answer."""
        register = self._registers.get("hardware_error_status")
        return self.bus.value(self.ids[k], register) if register else int(self.alerted[k])

    def _slow(self, registers: tuple[int, int], places: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """Place and bytes of each servo that answers."""
        chained = self._chained if self._layout.protocol == 1 and self.fast else ()
        replies = self.bus.read_all(*registers, [self.ids[k] for k in places], chained, CYCLE_PATIENCE)
        for identity, reply in replies.items():
            yield self._place[identity], reply.data


def _dtype(registers: Mapping[str, Register], start: int, size: int) -> np.dtype[Any]:
    """Return the registers of a reading of `size` bytes from `start` as columns."""
    names = [name for name, r in registers.items() if start <= r.address < start + size]
    found = [registers[name] for name in names]
    kinds = [f"<{'i' if r.signed and not r.direction else 'u'}{r.size}" for r in found]
    offsets = [r.address - start for r in found]
    return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": size})
