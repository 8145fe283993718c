"""Performers for tests: a made motion, its frames, a port without a network, and a stream that is no solver."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

import numpy as np
from perform import send

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.track import Status
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.receiver import Decoder, Packet, Receiver, UdpPort
from robot_retarget.robot import Robot
from robot_retarget.solver.stream import StreamPose as Answer

HOST = "127.0.0.1"


def clip(name: str = "wave", fps: float = 60.0) -> Motion:
    """A shipped clip at a performer's rate."""
    return read_motion(SAMPLES / f"{name}.bvh").resample(fps)


class Said:
    """Everything that was said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __call__(self, text: str) -> None:
        self.lines.append(text)

    def of(self, what: str) -> list[str]:
        return [line for line in self.lines if what in line]


class Script:
    """A port that returns prepared packets at prepared times."""

    def __init__(self, packets: list[Packet] | None = None) -> None:
        self.packets = list(packets or [])
        self.ended = False

    def receive(self, timeout: float) -> list[Packet]:
        found, self.packets = self.packets, []
        return found

    def close(self) -> None:
        self.ended = True


class Swing:
    """A stream that is no solver: the arms follow the height of the performer's hands, as far as they may turn in the time."""

    def __init__(self, robot: Robot, skeleton: Skeleton) -> None:
        self.robot = robot
        self.hands = [k for k, name in enumerate(skeleton.names) if "hand" in name.lower() or "wrist" in name.lower()][
            :2
        ]
        self.qpos, self.time = robot.standing(), float("-inf")
        self.pushed: list[float] = []

    def push(
        self,
        positions: Floats,
        rotations: Floats | None = None,
        *,
        time: float,
        poses: Mapping[str, Floats] | None = None,
    ) -> Answer:
        wish = self.robot.standing()
        arms = [k for k, name in enumerate(self.robot.joint_names) if "sho" in name]
        wish[self.robot.qpos_index[arms]] += 0.5 * np.sin(3 * positions[self.hands, 2].mean())
        self.pushed.append(time)
        self._go(wish, time)
        return Answer(self.qpos.copy(), time, Status.CONVERGED, 0.0)

    def hold(self, time: float) -> Answer:
        return Answer(self.qpos.copy(), self.time, Status.HELD, time - self.time)

    def _go(self, wish: Floats, time: float) -> None:
        reach = 3.0 * min(max(time - self.time, 0.0), 0.1)
        self.qpos = np.clip(wish, self.qpos - reach, self.qpos + reach)
        self.time = time


@contextmanager
def listening(
    decoder: Callable[[FaultCounter], Decoder], say: Callable[[str], None] = lambda text: None
) -> Iterator[Receiver]:
    """A receiver on a free port of this machine."""
    faults = FaultCounter(say)
    receiver = Receiver(UdpPort(HOST, 0, faults), decoder(faults), faults)
    try:
        yield receiver
    finally:
        receiver.close()


def port_of(receiver: Receiver) -> int:
    assert isinstance(receiver.port, UdpPort)
    return receiver.port.address[1]


@contextmanager
def performing(receiver: Receiver, motion: Motion, protocol: str = "vmc", **how: Any) -> Iterator[Event]:
    """A sender in a thread of its own, until the block is left or its event is set."""
    stop = Event()
    target = f"{protocol}://{HOST}:{port_of(receiver)}"
    thread = Thread(target=lambda: send(motion, target, stop=stop, seconds=60.0, **how), daemon=True)
    thread.start()
    try:
        yield stop
    finally:
        stop.set()
        thread.join(5)


def frames_for(receiver: Receiver, seconds: float) -> list[Any]:
    """The frames of so long [s]."""
    end, frames = time.monotonic() + seconds, []
    while time.monotonic() < end:
        frame = receiver.newest(0.05)
        if frame is not None:
            frames.append(frame)
    return frames
