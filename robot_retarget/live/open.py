"""Open a source by its name."""

import ipaddress
import socket
from collections.abc import Callable
from pathlib import Path

from robot_retarget.base.errors import UsageError
from robot_retarget.human.read import read_motion
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.headsets import HEADSETS, HeadsetSource
from robot_retarget.live.messages import LineDecoder
from robot_retarget.live.motion_files import Replay
from robot_retarget.live.ports import StdinPort, UdpPort
from robot_retarget.live.receiver import FrameSource, Receiver
from robot_retarget.scene import Scene

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
        return Replay(motion if scene is None else motion.with_scene(scene), faults, speed)
    if source == "vmc":
        from robot_retarget.live.vmc import PORT, VmcDecoder

        return Receiver(_udp(PORT if port is None else port, host, faults, sender, say), VmcDecoder(faults), faults)
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
