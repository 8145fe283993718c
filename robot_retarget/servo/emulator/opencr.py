"""An emulated OpenCR: answers for the inertial sensor on the trunk as ROBOTIS's board does."""

from collections.abc import Callable

import numpy as np

from robot_retarget.actuators.balance_tables import Imu
from robot_retarget.actuators.inertial import Reading
from robot_retarget.base.arrays import Floats
from robot_retarget.servo import protocol
from robot_retarget.servo.protocol import DynamixelPacket, Error, Instruction
from robot_retarget.servo.watch import GYRO, TABLE_END, encoded

MODEL = bytes((0x00, 0x73))
"""Model number, which no host of ours reads for more than an answer."""


class Board:
    """A device with an id that answers pings and reads; writes (lamps, buzzer, power) are accepted and do nothing.

    Args:
        imu: id and mounting.
        reading: the present one, in the root body's axes.
    """

    id: int

    def __init__(self, imu: Imu, reading: Callable[[], Reading]) -> None:
        self.id, self._mounting, self._reading = imu.id, imu.mounting, reading
        self.signs: Floats = np.ones(3)
        """Of the root body's axes, as measured; −1 where a sensor has a wrong sign."""
        self._kept: Reading | None = None

    def freeze(self) -> None:
        """Answer with the present reading from now on."""
        self._kept = self._reading()

    def answer(self, frame: DynamixelPacket) -> bytes | None:
        """The status of an instruction to this id, or None for none."""
        if frame.instruction == Instruction.PING:
            return protocol.status(self.id, 0, MODEL + bytes((1,)))
        if frame.instruction == Instruction.READ and len(frame.params) == 4:
            address, length = (int.from_bytes(frame.params[k : k + 2], "little") for k in (0, 2))
            if address + length > TABLE_END:
                return protocol.status(self.id, Error.ACCESS)
            gyro, accel = self._kept or self._reading()
            table = bytes(GYRO) + encoded(Reading(self.signs * gyro, self.signs * accel), self._mounting)
            return protocol.status(self.id, 0, table.ljust(TABLE_END, b"\0")[address : address + length])
        return protocol.status(self.id, 0 if frame.instruction == Instruction.WRITE else Error.INSTRUCTION)
