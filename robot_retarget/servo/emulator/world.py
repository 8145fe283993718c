"""Time, supply and plant: the loop between controllers and motors."""

import copy
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from robot_retarget.actuators.control_tables import ENCODER, OVERLOAD, SHOCK
from robot_retarget.actuators.motors import SUPPLY_RESISTANCE
from robot_retarget.base.errors import ServoError, known
from robot_retarget.servo.emulator.device import Device
from robot_retarget.servo.emulator.network import Network

if TYPE_CHECKING:
    from robot_retarget.servo.twin import Twin

STEP = 0.002
"""Of the built-in motors, and of a simulated pendulum [s]: MuJoCo's default."""
MOST_BEHIND = 0.1
"""A world that falls further behind the clock lets the time go [s]: the servos' watchdog of 0.1 s has ended a playback by
then."""


class World:
    """Steps all devices along the clock."""

    def __init__(self, devices: Sequence[Device], plant: "Twin | None" = None) -> None:
        self.devices: list[Device] = list(devices)
        self.plant = plant
        self.supply: float | None = None
        """Voltage of the supply without load [V]; None gives each servo its own nominal one."""
        self.step: float = plant.step if plant else STEP
        self.time: float = 0.0
        self.lost: float = 0.0
        """Skipped time, where the machine was too slow [s]."""
        if plant is not None:
            self._take_over()

    def advance(self, now: float) -> None:
        """Bring the world to `now` [s since its beginning]."""
        if now - self.time > MOST_BEHIND:
            self.lost += now - MOST_BEHIND - self.time
            self.time = now - MOST_BEHIND
        while self.time + self.step <= now:
            self.time += self.step
            self._step()

    def _step(self) -> None:
        drawn = sum(abs(device.motor.current) for device in self.devices)
        for device in self.devices:
            volts = device.model.motor.voltage if self.supply is None else self.supply
            device.control(self.time, self.step, volts - SUPPLY_RESISTANCE * drawn * (self.supply is not None))
        if self.plant is None:
            for device in self.devices:
                device.motor.step_plant(device.voltage, self.step)
        else:
            torques = [device.motor.torque(device.voltage) for device in self.devices]
            jammed = [device.motor.jammed for device in self.devices]
            self.plant.advance(torques, [device.torque for device in self.devices], jammed)
            self._take_over()
        for device in self.devices:
            device.motor.update_load(device.voltage, self.step)

    def _take_over(self) -> None:
        """Bring the plant's shafts into the motors."""
        assert self.plant is not None
        for device, ticks, speed in zip(self.devices, *self.plant.shafts(), strict=True):
            turn = device.shaft.turn
            device.motor.position = ticks + turn * round((device.motor.position - ticks) / turn)
            device.motor.velocity = speed


# Faults on request, as sentences: on the command line, or while the emulator runs.
#
#     silent 3        servo 3 no longer hears or answers; `heard 3` brings it back; `silent all`
#     drop 0.05       share of answers that are lost
#     corrupt 0.05    share of answers with a wrong bit
#     delay 5         answers are late by this time [ms]
#     noise 0.05      share of answers after noise bytes
#     echo 1          the host hears itself, as on an adapter without direction control
#     overload 3      a hardware error of servo 3: overload, encoder, shock
#     jam 3           something holds the shaft of servo 3; `free 3` lets it turn again
#     heat 3 85       servo 3 is so hot [°C]
#     supply 9.5      voltage of the supply [V]
#     model 3 1060    servo 3 answers with this model number
#     duplicate 3 4   servo 4 gets the id 3, too
#     place 3 2100    the shaft of servo 3 is turned to this position by hand
#     torque 3        torque of servo 3 is switched on by somebody else
#     limp 3          torque of servo 3 is switched off by another program
#     flip x          the inertial sensor measures the root body's x axis with the wrong sign
#     freeze          the inertial sensor repeats its present reading
#     reset           servos, wire and supply are as at the start
#     wait 0.5        time passes [s], in lockstep
#     unplug          the cable is pulled; `plug` puts it back (a new port under the same link)
#
# `after 2.5 silent 3` does it 2.5 s after the start.

HARDWARE = {"encoder": ENCODER, "shock": SHOCK, "overload": OVERLOAD}


@dataclass
class Wire:
    """How bad the cable is."""

    drop: float = 0.0
    corrupt: float = 0.0
    noise: float = 0.0
    delay: float = 0.0
    """[s]."""
    echo: bool = False
    plugged: bool = True
    chance: random.Random = field(default_factory=lambda: random.Random(1))

    def received(self, answer: bytes) -> bytes:
        """Return an answer as the host receives it."""
        if self.drop and self.chance.random() < self.drop:
            return b""
        if self.corrupt and self.chance.random() < self.corrupt:
            place = self.chance.randrange(len(answer))
            flipped = answer[place] ^ 1 << self.chance.randrange(8)
            answer = answer[:place] + bytes((flipped,)) + answer[place + 1 :]
        if self.noise and self.chance.random() < self.noise:
            answer = self.chance.randbytes(self.chance.randrange(1, 12)) + answer
        return answer


class FaultInjector:
    """Carries out fault sentences on a network, a world and a wire."""

    def __init__(self, network: Network, world: World, wire: Wire) -> None:
        self.network, self.world, self.wire = network, world, wire
        self.struck: float = 0.0
        """When the last one happened [s]."""
        self._later: list[tuple[float, str]] = []
        self._fresh = [copy.deepcopy(vars(device)) for device in network.devices]
        self._actions: dict[str, Callable[..., object]] = {
            "silent": lambda who: self.network.silent.update(self._ids(who)),
            "heard": lambda who: self.network.silent.difference_update(self._ids(who)),
            "drop": lambda share: setattr(self.wire, "drop", float(share)),
            "corrupt": lambda share: setattr(self.wire, "corrupt", float(share)),
            "noise": lambda share: setattr(self.wire, "noise", float(share)),
            "delay": lambda ms: setattr(self.wire, "delay", float(ms) / 1000),
            "echo": lambda on: setattr(self.wire, "echo", bool(int(on))),
            "heat": lambda who, celsius: [setattr(d.motor, "temperature", float(celsius)) for d in self._devices(who)],
            "jam": lambda who: [setattr(d.motor, "jammed", True) for d in self._devices(who)],
            "free": lambda who: [setattr(d.motor, "jammed", False) for d in self._devices(who)],
            "supply": lambda volts: setattr(self.world, "supply", float(volts)),
            "model": lambda who, number: self._set(who, "model_number", int(number)),
            "duplicate": lambda who, other: self._set(other, "id", int(who)),
            "torque": lambda who: [d.write(d.model.layout.state[0], b"\x01") for d in self._devices(who)],
            "limp": lambda who: [d.write(d.model.layout.state[0], b"\x00") for d in self._devices(who)],
            "place": lambda who, ticks: [d.place(float(ticks)) for d in self._devices(who)],
            "flip": self._flip,
            "freeze": lambda: [board.freeze() for board in self.network.boards],
            "reset": self._reset,
            "wait": lambda seconds: self.world.advance(self.world.time + float(seconds)),
            "unplug": lambda: setattr(self.wire, "plugged", False),
            "plug": lambda: setattr(self.wire, "plugged", True),
        }
        for name, bit in HARDWARE.items():
            self._actions[name] = lambda who, bit=bit: [d.fail(bit) for d in self._devices(who)]

    def add(self, sentence: str) -> None:
        """Carry out a sentence, now or after its time.

        Raises:
            ServoError: the sentence means nothing.
        """
        words = sentence.split()
        if words[:1] == ["after"] and len(words) > 2:
            try:
                self._later.append((float(words[1]), " ".join(words[2:])))
            except ValueError:
                raise ServoError(f"fault {sentence!r}: {words[1]!r} is no time") from None
            return
        action = self._actions.get(words[0] if words else "")
        if action is None:
            raise ServoError(f"no fault {sentence!r}; {known(self._actions)}")
        try:
            action(*words[1:])
            self.struck = self.world.time
            # Supply and heat are felt with the next step of the world: this is it.
            self.world.advance(self.world.time + self.world.step)
        except (TypeError, ValueError) as error:
            raise ServoError(f"fault {sentence!r}: {error}") from None

    def run_due(self, now: float) -> None:
        """Carry out the sentences due until `now` [s]."""
        for planned in [p for p in self._later if p[0] <= now]:
            self._later.remove(planned)
            self.add(planned[1])

    def _flip(self, axis: str) -> None:
        for board in self.network.boards:
            board.signs["xyz".index(axis)] = -1.0

    def _reset(self) -> None:
        for device, fresh in zip(self.network.devices, self._fresh, strict=True):
            vars(device).update(copy.deepcopy(fresh))
            device.now = self.world.time
            device.boot()
        vars(self.wire).update(vars(Wire()))
        self.network.silent.clear()
        self.world.supply = None

    def _ids(self, who: str) -> set[int]:
        """Of servos, and of the sensor board."""
        boards = {board.id for board in self.network.boards if who in ("all", str(board.id))}
        return boards | {device.id for device in self._devices(who)} if who == "all" or not boards else boards

    def _devices(self, who: str) -> list[Device]:
        found = [d for d in self.network.devices if who == "all" or d.id == int(who)]
        if not found:
            raise ValueError(f"no servo {who}; {known(str(d.id) for d in self.network.devices)}")
        return found

    def _set(self, who: str, register: str, value: int) -> None:
        for device in self._devices(who):
            device.registers[register] = value
