"""Time, supply and plant: the loop between controllers and motors."""

from collections.abc import Sequence
from typing import Any, Protocol

from robot_retarget.servo.emulator.device import Device

STEP = 0.002
"""Of the built-in motors [s]."""
MOST_BEHIND = 0.1
"""A world that falls further behind the clock lets the time go [s]."""
SUPPLY_RESISTANCE = 0.05
"""Of battery and cables [Ω]."""


class EmulatedPlant(Protocol):
    """A body moved by the motors, in their order: encoder ticks of each, torque at its output."""

    step: float
    """[s]."""

    def advance(self, torques: Sequence[float], holding: Sequence[bool]) -> None:
        """Step under torques [N m]; `holding` marks servos with torque on."""
        ...

    def shafts(self) -> tuple[Sequence[float], Sequence[float]]:
        """Positions [ticks] and velocities [ticks/s] of the encoders."""
        ...

    def state(self) -> dict[str, Any]:
        """Return the state for tests."""
        ...

    def close(self) -> None:
        """No more steps are coming."""
        ...


class World:
    """Steps all devices along the clock."""

    def __init__(
        self, devices: Sequence[Device], plant: EmulatedPlant | None = None, supply: float | None = None
    ) -> None:
        self.devices: list[Device] = list(devices)
        self.plant = plant
        self.supply = supply
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
            self.plant.advance(torques, [device.torque for device in self.devices])
            self._take_over()
        for device in self.devices:
            device.motor.update_load(device.voltage, self.step)

    def _take_over(self) -> None:
        """Bring the plant's shafts into the motors."""
        assert self.plant is not None
        for device, ticks, speed in zip(self.devices, *self.plant.shafts(), strict=True):
            turns = round((device.motor.position - ticks) / 4096)
            device.motor.position, device.motor.velocity = ticks + 4096 * turns, speed
