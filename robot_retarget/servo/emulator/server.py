"""The emulated bus on a pseudo terminal: bytes in, bytes out, time in between."""

import contextlib
import errno
import fcntl
import json
import os
import select
import signal
import sys
import termios
import time
import tty
import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from robot_retarget.actuators.control_tables import BAUDS
from robot_retarget.base.errors import ServoError
from robot_retarget.servo.emulator.network import Network
from robot_retarget.servo.emulator.world import FaultInjector, Wire, World
from robot_retarget.servo.host import real_time
from robot_retarget.servo.protocol import NO_MORE, Instruction

# Transfer times of a real wire, servo and USB adapter.

TURNAROUND = 50e-6
"""From the end of a request, or of another servo's answer, to the start of a servo's answer [s]."""


@dataclass
class WireTiming:
    """The clock of a bus; times in seconds. A baud rate of None makes everything immediate."""

    baud: int | None = None
    usb_latency: float = 0.0
    """Latency of the adapter [s]."""
    free: float = 0.0
    """Time at which the wire is next free [s]."""

    def request(self, now: float, size: int) -> None:
        """Occupy the wire with a request of `size` bytes."""
        if self.baud:
            self.free = max(now, self.free) + size * 10 / self.baud

    def answer(self, now: float, size: int, delay: float) -> float:
        """Return the time at which the host has an answer of `size` bytes, sent after a return delay [s]."""
        if not self.baud:
            return now
        self.free = max(now, self.free) + TURNAROUND + delay + size * 10 / self.baud
        return self.free + self.usb_latency


FRAME_SILENCE = 0.01
"""The rest of a frame that has not come after this is not coming [s]: 57 bytes at the 57,600 baud of a new servo."""
TICK = 0.01
"""Longest interval between two updates of the world [s]."""
AWAKE = 60e-6
"""Time before an answer is due at which the loop wakes up [s]: the timer slack of Linux is 50 µs."""
HUSH = 0.3e-3
"""The world is not stepped for this time before and after an answer is due [s], so that a host that asks again at once is
answered in time."""
BAUD_CODES = {
    getattr(termios, f"B{baud}"): baud
    for rates in BAUDS.values()
    for baud in rates.values()
    if hasattr(termios, f"B{baud}")
}


class Terminal:
    """A raw pseudo terminal under a stable name."""

    def __init__(self, link: Path | None) -> None:
        self.link = link
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path: str = os.ttyname(self._slave)
        if link is not None:
            self._name(link)

    def _name(self, link: Path) -> None:
        """Link a stable name to the port. A lock reserves the name while this emulator runs."""
        if link.is_symlink() and _taken(link):
            self.close()
            raise ServoError(f"{link} is the port of another emulator: stop that one, or give another --link")
        if link.exists() and not link.is_symlink():
            self.close()
            raise ServoError(f"{link} is in the way: it is no link of an emulator")
        try:
            fcntl.lockf(self._slave, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte_of(link))
            link.unlink(missing_ok=True)
            link.symlink_to(self.path)
        except OSError as error:
            self.close()
            raise ServoError(f"cannot link {link}: {error.strerror}") from error

    @property
    def baud(self) -> int | None:
        """Return the baud rate that the host set, if known."""
        return BAUD_CODES.get(termios.tcgetattr(self._slave)[4])

    def allow_reopening(self) -> None:
        """Undo a TIOCEXCL that a dead host has left behind; it would lock everybody out."""
        fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError, OSError):
            return os.read(self.master, 65536)
        return b""

    def write(self, data: bytes) -> None:
        """Write to the host; unread bytes are lost, as on a wire."""
        with contextlib.suppress(BlockingIOError):
            os.write(self.master, data)

    def close(self) -> None:
        os.close(self.master)
        os.close(self._slave)
        if self.link is not None and self.link.is_symlink() and os.readlink(self.link) == self.path:
            self.link.unlink()


def _byte_of(link: Path) -> int:
    """Return the byte that the owner of a name locks: another emulator may have got the port of a killed one."""
    return zlib.crc32(str(link.absolute()).encode())


def _taken(link: Path) -> bool:
    """Return whether the port behind a link belongs to a living emulator, which holds a lock on it."""
    try:
        port = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        return error.errno == errno.EBUSY  # a host has the port for itself
    try:
        fcntl.lockf(port, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _byte_of(link))
    except OSError:
        return True
    finally:
        os.close(port)
    return False


class Server:
    """Runs a network and its world behind a pseudo terminal until it is stopped."""

    def __init__(
        self,
        network: Network,
        world: World,
        timing: WireTiming,
        link: Path | None,
        strict: bool = False,
        lockstep: float | None = None,
    ) -> None:
        """`lockstep`: time by which each frame of goals advances the world, instead of the clock [s]."""
        self._lockstep, self._due = lockstep, 0.0
        self.network, self.world, self.timing, self.strict = network, world, timing, strict
        self.wire: Wire = Wire()
        self.faults: FaultInjector = FaultInjector(network, world, self.wire)
        self.terminal: Terminal | None = Terminal(link)
        self._link = link
        self._parser = network.codec.parser(strict)
        self._out: deque[tuple[float, bytes]] = deque()
        self._began = time.monotonic()
        self._heard = self._through = 0.0
        self._stop = False

    def run(self, commands: bool = False) -> None:
        """Serve until SIGTERM or SIGINT; `commands` also reads fault sentences, `state` and `stop` from stdin."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        assert self.terminal is not None
        print(f"ready {self._link or self.terminal.path}", flush=True)
        try:
            with real_time():
                while not self._stop:
                    self._turn(commands)
        finally:
            if self.terminal is not None:
                self.terminal.close()
            if self.world.plant is not None:
                self.world.plant.close()

    def _turn(self, commands: bool) -> None:
        """Run one round: wait for bytes, commands or the next due time, then process them."""
        wanted = [self.terminal.master] if self.terminal else []
        ready, _, _ = select.select([*wanted, *([sys.stdin] if commands else [])], [], [], self._patience())
        if self.terminal is not None and not ready:
            # Due answers go out before the world is stepped.
            self._send(self.terminal)
        now = time.monotonic() - self._began
        if self._lockstep is None and (abs(now - self._through) > HUSH or now - self.world.time > TICK):
            self.world.advance(now)
        self.faults.run_due(now if self._lockstep is None else self.world.time)
        if self.terminal is not None:
            if self.terminal.master in ready:
                self._listen(self.terminal, now)
            elif self._parser.pending and now - self._heard > FRAME_SILENCE:
                self._answer(self._parser.give_up(), now)
            self._send(self.terminal)
        if sys.stdin in ready:
            self._command(sys.stdin.readline())
        self._follow_plug()

    def _patience(self) -> float:
        if not self._out:
            return TICK
        return min(TICK, max(0.0, self._out[0][0] - AWAKE - (time.monotonic() - self._began)))

    def _listen(self, terminal: Terminal, now: float) -> None:
        data = terminal.read()
        self._heard = now
        terminal.allow_reopening()
        if self.strict and terminal.baud not in {
            BAUDS[d.model.protocol][d.registers["baud_rate"]] for d in self.network.devices
        }:
            return
        if self.wire.echo:
            self._out.append((now, data))
        self._answer(self._parser.feed(data), now)

    def _answer(self, frames: Sequence[Any], now: float) -> None:
        for frame in frames:
            if self._lockstep is not None and self._has_goals(frame):
                self._due += self._lockstep
                if self.world.time > self._due:  # `wait`
                    self._due = self.world.time + self._lockstep
                self.world.advance(self._due + self.world.step / 2)  # whole steps in spite of rounding
                self.faults.run_due(self.world.time)
            self.timing.request(now, frame.size)
            for answer in self.network.answer(frame):
                due = self.timing.answer(now, len(answer.data), answer.delay) + self.wire.delay
                self._out.append((due, self.wire.received(answer.data)))
                self._through = due
            if self._lockstep is not None and frame.instruction != Instruction.SYNC_WRITE:
                self._out.append((self._through if self._out else now, NO_MORE))

    def _has_goals(self, frame: Any) -> bool:
        """Whether a frame is a sync write of goal positions."""
        goals = self.network.codec.number(self.network.devices[0].model.layout.goal[0])
        return frame.instruction == Instruction.SYNC_WRITE and frame.params.startswith(goals)

    def _send(self, terminal: Terminal) -> None:
        """Send all answers that are due; wait for those due within a moment."""
        now, through = time.monotonic() - self._began, []
        while self._out and self._out[0][0] <= now + AWAKE:
            due, data = self._out.popleft()
            while now < due:
                now = time.monotonic() - self._began
            through.append(data)
        if through:
            terminal.write(b"".join(through))

    def _follow_plug(self) -> None:
        if self.terminal is not None and not self.wire.plugged:
            self.terminal.close()
            self.terminal = None
            self._parser.clear()
            self._out.clear()
        elif self.terminal is None and self.wire.plugged:
            self.terminal = Terminal(self._link)

    def _command(self, line: str) -> None:
        """Obey a line from stdin: `stop`, `state`, or a fault to strike with; print the state or the error as a line of JSON."""
        words = line.split()
        if not words or words == ["stop"]:
            self._stop = True
            return
        try:
            if words != ["state"]:
                self.faults.add(line.strip())
                self._follow_plug()
            print(json.dumps(self.state()), flush=True)
        except ServoError as error:
            print(json.dumps({"error": str(error)}), flush=True)

    def state(self) -> dict[str, Any]:
        """Return the state for tests."""
        servos = {}
        for device in self.network.devices:
            device.publish()
            names = ("torque_enable", "goal_position", "present_position", "bus_watchdog", "hardware_error_status")
            servos[str(device.id)] = {n: device.registers[n] for n in names} | vars(device.writes)
        body = self.world.plant.state() if self.world.plant else {}
        times = {"time": self.world.time, "lost": self.world.lost, "struck": self.faults.struck}
        return times | {"servos": servos, "body": body}

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stop = True
