"""All servos on one wire: who answers what to which instruction."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.actuators.balance_tables import Imu
from robot_retarget.actuators.control_tables import RETURN_DELAY_UNIT
from robot_retarget.actuators.inertial import Reading
from robot_retarget.base.arrays import Floats
from robot_retarget.servo import protocol
from robot_retarget.servo.emulator.device import Device
from robot_retarget.servo.protocol import BROADCAST, DynamixelPacket, Error, Instruction
from robot_retarget.servo.watch import GYRO, TABLE_END, encoded

# An emulated OpenCR: answers for the inertial sensor on the trunk as ROBOTIS's board does.

MODEL = bytes((0x00, 0x73))
"""Model number, which no host of ours reads for more than an answer."""


class Board:
    """A device with an id that answers pings and reads; writes (lamps, buzzer, power) are accepted and do nothing.

    Args:
        imu: id and mounting.
        reading: the present one, in the root body's axes.
    """

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


ANSWERED_FROM: dict[int, int] = {Instruction.PING: 0, Instruction.READ: 1}
"""The status return level from which an instruction is answered; all others from 2."""
LONGEST_STATUS = 0xFFFF
"""Largest length that a status can state [B]; servos do not answer a fast read of more."""


@dataclass(frozen=True)
class Answer:
    """Bytes that one servo (or a chain of them) puts on the wire."""

    data: bytes
    delay: float
    """The servo's return delay before them [s]."""
    turns: int = 1
    """Servos that took their turn for it."""


class Network:
    """Devices that share a bus. `answer` is all a host ever sees of them."""

    def __init__(self, devices: Sequence[Device], boards: Sequence[Board] = (), codec: Any = protocol) -> None:
        self.devices, self.boards, self.codec = list(devices), list(boards), codec
        self.silent: set[int] = set()
        """Ids whose servos have lost their cable."""

    def at(self, identity: int) -> list[Device]:
        """Who listens to an id: one as a rule, none when missing, two when it was given twice."""
        if identity in self.silent:
            return []
        return [device for device in self.devices if device.powered and device.id == identity]

    def listening(self) -> list[Device]:
        """Every device whose cable is plugged."""
        return [device for device in self.devices if device.powered and device.id not in self.silent]

    def answer(self, frame: DynamixelPacket) -> list[Answer]:
        """Execute an instruction. Returns the answers in order, an empty list without any."""
        if frame.instruction == Instruction.STATUS:
            return []
        for device in self.listening():
            device.feed()
        board = next((board for board in self.boards if board.id == frame.id), None)
        if board is not None:
            data = None if board.id in self.silent else board.answer(frame)
            return [] if data is None else [Answer(data, 0.0)]
        group = _GROUPS[self.codec.VERSION].get(frame.instruction)
        if group is not None:
            return group(self, frame.params) if frame.id == BROADCAST else []
        if frame.id != BROADCAST:
            return self._merged([a for d in self.at(frame.id) if (a := self._single(d, frame))])
        answers = [self._single(device, frame) for device in sorted(self.listening(), key=lambda d: d.id)]
        return [a for a in answers if a] if frame.instruction == Instruction.PING else []

    def _single(self, device: Device, frame: DynamixelPacket) -> Answer | None:
        """Return one device's answer to an instruction."""
        level = device.registers["status_return_level"]
        delay = device.registers["return_delay_time"] * RETURN_DELAY_UNIT
        identity = device.id
        error, data = self._perform(device, frame)
        needed = ANSWERED_FROM.get(frame.instruction, 2)
        if level < needed:
            return None
        return Answer(self.codec.status(identity, error, data, device.hardware), delay)

    def _merged(self, answers: list[Answer]) -> list[Answer]:
        """Two servos on one id talk at once: the wire carries the AND of their bytes."""
        if len(answers) < 2:
            return answers
        longest = max(len(a.data) for a in answers)
        mixed = bytes(longest * [0xFF])
        for answer in answers:
            mixed = bytes(a & b for a, b in zip(mixed, answer.data.ljust(longest, b"\xff"), strict=True))
        return [Answer(mixed, answers[0].delay)]

    def _read(self, identity: int, address: int, length: int) -> list[Answer]:
        number = self.codec.number
        frame = DynamixelPacket(identity, Instruction.READ, number(address) + number(length))
        return self._merged([a for d in self.at(identity) if (a := self._single(d, frame))])

    def _sync_read(self, params: bytes) -> list[Answer]:
        if len(params) < 5:
            return []
        address, length = _words(params)
        return [a for identity in params[4:] for a in self._read(identity, address, length)]

    def _fast_sync_read(self, params: bytes) -> list[Answer]:
        """One answer of all; the first servo announces its whole length, each adds its block to what came before."""
        if len(params) < 5:
            return []
        address, length = _words(params)
        blocks: list[tuple[int, int, bytes]] = []
        delay = 0.0
        for identity in params[4:]:
            devices = [d for d in self.at(identity) if _fast(d)]
            if not devices:
                break
            error, data = devices[0].read(address, length)
            data = data if not error else bytes(length)
            blocks.append((error | (protocol.ALERT if devices[0].hardware else 0), identity, data))
            delay = delay or devices[0].registers["return_delay_time"] * RETURN_DELAY_UNIT
        if not blocks or 1 + (4 + length) * len(params[4:]) > LONGEST_STATUS:
            return []
        whole = protocol.fast_status([*blocks, *((0, i, bytes(length)) for i in params[4 + len(blocks) :])])
        sent = 8 + sum(4 + len(data) for _, _, data in blocks)
        return [Answer(whole[:sent], delay, len(blocks))]

    def _sync_write(self, params: bytes) -> list[Answer]:
        width = len(self.codec.number(0))
        if len(params) < 2 * width:
            return []
        address, length = _words(params, width)
        for k in range(2 * width, len(params) - length, length + 1):
            for device in self.at(params[k]):
                device.write(address, params[k + 1 : k + 1 + length])
        return []

    def _bulk_read(self, params: bytes) -> list[Answer]:
        """Under Protocol 1 each servo waits for the answer of the one before: servos after a missing one stay silent."""
        answers: list[Answer] = []
        for length, identity, address in (params[k : k + 3] for k in range(1, len(params) - 2, 3)):
            found = self._read(identity, address, length) if all(map(_fast, self.at(identity))) else []
            if not found:
                break
            answers += found
        return answers

    def _perform(self, device: Device, frame: DynamixelPacket) -> tuple[int, bytes]:
        """Error code and data of an instruction to one device."""
        params, kind, width = frame.params, frame.instruction, len(self.codec.number(0))
        if kind == Instruction.PING:
            data = device.read(0, 2)[1] + bytes((device.registers["firmware_version"],))
            return 0, data[: self.codec.PING_DATA]
        if kind == Instruction.READ:
            return device.read(*_words(params, width)) if len(params) == 2 * width else (Error.DATA_LENGTH, b"")
        if kind == Instruction.WRITE:
            if len(params) <= width:
                return Error.DATA_LENGTH, b""
            return device.write(int.from_bytes(params[:width], "little"), params[width:]), b""
        return _maintain(device, frame) if self.codec.VERSION == 2 else (Error.INSTRUCTION, b"")


def _maintain(device: Device, frame: DynamixelPacket) -> tuple[int, bytes]:
    """Error code and data of the rarer instructions."""
    params, kind = frame.params, frame.instruction
    if kind == Instruction.REBOOT:
        device.boot()
        return Error.NONE, b""
    if kind == Instruction.CLEAR:
        return device.clear(params), b""
    if kind == Instruction.FACTORY_RESET:
        everything = params[:1] == b"\xff" and frame.id == BROADCAST
        return Error.NONE if everything else device.factory_reset(params[0] if params else 0), b""
    return Error.INSTRUCTION, b""


def _fast(device: Device) -> bool:
    """Whether a device takes part in fast reads."""
    return device.registers["firmware_version"] >= device.model.fast_from > 0


def _words(params: bytes, width: int = 2) -> tuple[int, int]:
    """Return the first two numbers of parameters, of `width` bytes each."""
    return int.from_bytes(params[:width], "little"), int.from_bytes(params[width : 2 * width], "little")


_GROUPS: dict[int, dict[int, Callable[[Network, bytes], list[Answer]]]] = {
    1: {Instruction.SYNC_WRITE: Network._sync_write, Instruction.BULK_READ: Network._bulk_read},
    2: {
        Instruction.SYNC_READ: Network._sync_read,
        Instruction.SYNC_WRITE: Network._sync_write,
        Instruction.FAST_SYNC_READ: Network._fast_sync_read,
    },
}
"""Instructions to several servos, by protocol."""
