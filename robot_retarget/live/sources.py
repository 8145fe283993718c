"""Open a source by its name; motion files as sources, and the calibration of a performer."""

import ipaddress
import socket
import time
from collections.abc import Callable
from math import floor
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import MotionError, UsageError
from robot_retarget.base.files import replacing
from robot_retarget.base.untrusted.arrays import FARTHEST, Field, read_fields
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.human.surroundings import with_scene
from robot_retarget.live.frame import FaultCounter, Frame
from robot_retarget.live.headsets import HEADSETS, HeadsetSource
from robot_retarget.live.messages import LineDecoder
from robot_retarget.live.receiver import FrameSource, Receiver, StdinPort, UdpPort
from robot_retarget.scene import Scene

# Motion files in a live stream: replayed in real time, and the calibration of a performer.


class Replay:
    """Return the frames of a motion when they are due, starting with the first call; drop overdue ones.

    Raises:
        UsageError: the speed is not positive.
    """

    motion: Motion
    faults: FaultCounter
    dropped: int

    def __init__(self, motion: Motion, faults: FaultCounter, speed: float = 1.0) -> None:
        if not 0 < speed < float("inf"):
            raise UsageError(f"--speed must be positive, got {speed:g}")
        self.motion, self.faults, self.dropped = motion, faults, 0
        self._rate, self._next = motion.fps * speed, 0
        self.began: float | None = None
        """Due time of the first frame [s]."""

    @property
    def skeleton(self) -> Skeleton:
        return self.motion.skeleton

    @property
    def ended(self) -> bool:
        return self._next >= len(self.motion)

    def newest(self, timeout: float) -> Frame | None:
        if self.ended:
            return None
        if self.began is None:
            self.began = time.monotonic()
        ahead = self.began + self._next / self._rate - time.monotonic()
        if ahead > timeout:
            time.sleep(max(timeout, 0.0))
            return None
        time.sleep(max(ahead, 0.0))
        due = min(floor((time.monotonic() - self.began) * self._rate + 1e-6), len(self.motion) - 1)
        t = max(due, self._next)
        self.dropped += t - self._next
        self._next = t + 1
        made, motion = self.began + t / self._rate, self.motion
        turns = None if motion.rotations is None else motion.rotations[t]
        arrived = max(time.monotonic(), made)
        return Frame(motion.skeleton, made, arrived, motion.positions[t], turns, motion.poses_at(t))

    def close(self) -> None:
        """Do nothing: no port is held."""


FIELDS = {
    "names": Field("text", ("J",)),
    "parents": Field("integer", ("J",), bounds=(-1, np.inf)),
    "offsets": Field("number", ("J", 3), (-FARTHEST, FARTHEST)),
    "positions": Field("number", ("T", "J", 3), (-FARTHEST, FARTHEST)),
    "fps": Field("number", bounds=(1, 1000)),
    "rotations": Field("number", ("T", "J", 4), (-1.01, 1.01), required=False),
}
"""Of the file."""


def save_calibration(motion: Motion, path: str | Path) -> None:
    """Write a calibration, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    skeleton = motion.skeleton
    arrays: dict[str, Any] = {
        "names": np.array(skeleton.names), "parents": skeleton.parents, "offsets": skeleton.offsets,
        "positions": motion.positions, "fps": np.array(motion.fps),
    }  # fmt: skip
    arrays |= {} if motion.rotations is None else {"rotations": motion.rotations}
    with replacing(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_calibration(path: str | Path) -> Motion:
    """Read a calibration that `save_calibration` wrote.

    Raises:
        MotionError: The file cannot be read, or is not a calibration.
    """
    values = read_fields(path, FIELDS, MotionError)
    if "rotations" in values and not np.allclose(np.linalg.norm(values["rotations"], axis=-1), 1, atol=0.01):
        raise MotionError("rotations must be unit quaternions", path)
    skeleton = Skeleton(tuple(values["names"].tolist()), values["parents"], values["offsets"])
    return Motion(skeleton, values["positions"], values.get("rotations"), float(values["fps"]), str(path))


# Open a source by its name.

RECEIVED = ("vmc", "json")
SOURCES = (*RECEIVED, *HEADSETS)
LOOPBACK = "127.0.0.1"
"""Address that only this machine reaches."""


def opened(
    source: str,
    port: int | None = None,
    host: str = LOOPBACK,
    sender: str = "",
    speed: float = 1.0,
    scene: Scene | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> FrameSource:
    """Open a source that listens, or one that plays a motion file.

    Args:
        source: `vmc`, `json`, `xrt`, `isaac` or the path of a motion file.
        port: UDP port to listen at; by default that of VMC, or standard input for `json`.
        host: address to listen at; `0.0.0.0` lets other machines send.
        sender: name or address of the only machine that may send; empty for any.
        speed: factor on the speed of a motion file.
        scene: bodies around the human of a motion file.
        say: receives reports of faults.

    Raises:
        UsageError: options contradict each other, or the port cannot be used.
        MotionError: a motion file cannot be read.
        SceneError: a body does not fit the motion file.
    """
    faults = FaultCounter(say)
    if source not in RECEIVED:
        _refuse_idle(source, port, sender)
        if source in HEADSETS:
            return HeadsetSource(HEADSETS[source](), faults)
        motion = read_motion(source)
        return Replay(motion if scene is None else with_scene(motion, scene), faults, speed)
    if source == "vmc":
        from robot_retarget.live.vmc import VMC_PORT, VmcDecoder

        return Receiver(_udp(VMC_PORT if port is None else port, host, faults, sender, say), VmcDecoder(faults), faults)
    if port is not None:
        return Receiver(_udp(port, host, faults, sender, say), LineDecoder(faults, whole=True), faults)
    if sender:
        raise UsageError("--sender needs --port")
    return Receiver(StdinPort(), LineDecoder(faults), faults)


def _udp(port: int, host: str, faults: FaultCounter, sender: str, say: Callable[[str], None]) -> UdpPort:
    """Open a port and say who may send to it, and the option that changes it."""
    try:
        opening = UdpPort(host, port, faults, socket.gethostbyname(sender) if sender else "")
    except socket.gaierror as error:
        raise UsageError(f"--sender {sender}: {error.strerror or error}") from None
    if ipaddress.ip_address(opening.address[0]).is_loopback:
        who = "this machine may send; --host 0.0.0.0 lets others"
    else:
        who = f"{sender} may send" if sender else "any machine may send; --sender ADDRESS admits one only"
    say(f"listening on UDP {opening.address[0]}:{opening.address[1]}: {who}")
    return opening


def _refuse_idle(source: str, port: int | None, sender: str) -> None:
    if source not in HEADSETS and not Path(source.partition("#")[0]).exists():
        raise UsageError(f"--from {source!r} is neither a motion file nor one of {', '.join(SOURCES)}")
    given = "--port" if port is not None else "--sender" if sender else ""
    if given:
        kind = "headset" if source in HEADSETS else "file"
        raise UsageError(f"{given} applies to received frames; {source} is a {kind}")
