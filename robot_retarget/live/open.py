"""Open a source by its name."""

import importlib.util
import ipaddress
import socket
from collections.abc import Callable
from pathlib import Path

from robot_retarget.base.errors import UsageError, install_line
from robot_retarget.human.read import read_motion
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.live.frame import FaultCounter
from robot_retarget.live.headsets import HEADSETS, HeadsetSource
from robot_retarget.live.messages import FloatDecoder, LineDecoder
from robot_retarget.live.motion_files import Replay
from robot_retarget.live.ports import InputPort, StdinPort, TcpPort, UdpPort
from robot_retarget.live.receiver import FrameSource, Receiver
from robot_retarget.scene import Scene

RECEIVED = ("vmc", "json", "floats")
SOURCES = (*RECEIVED, *HEADSETS)
LOOPBACK = "127.0.0.1"
"""Address that only this machine reaches."""


def opened(
    source: str,
    port: int | None = None,
    host: str = LOOPBACK,
    tcp: bool = False,
    sender: str = "",
    skeleton: Path | None = None,
    speed: float = 1.0,
    scene: Scene | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> FrameSource:
    """Open a source that listens, or one that plays a motion file.

    Args:
        source: `vmc`, `json`, `floats`, `xrt`, `isaac` or the path of a motion file.
        port: port to listen at; by default that of VMC, or standard input for the other protocols.
        host: address to listen at; `0.0.0.0` lets other machines send.
        tcp: accept connections instead of datagrams.
        sender: name or address of the only machine that may send; empty for any.
        skeleton: motion file with the skeleton of `floats`, and of `json` until a line defines one.
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
        _refuse_idle(source, port, tcp, skeleton, sender)
        if source in HEADSETS:
            return HeadsetSource(HEADSETS[source](), faults)
        motion = read_motion(source)
        return Replay(motion if scene is None else motion.with_scene(scene), faults, speed)
    known = None if skeleton is None else read_motion(skeleton).skeleton
    if source == "vmc":
        from robot_retarget.live.vmc import PORT, VmcDecoder

        if tcp or known:
            raise UsageError("vmc is UDP and names its bones: leave out --tcp and --skeleton")
        opening = _port(PORT if port is None else port, host, tcp, faults, sender, say)
        return Receiver(opening, VmcDecoder(faults), faults)
    whole = port is not None and not tcp
    decoder = LineDecoder(faults, known, whole) if source == "json" else _floats(faults, known, whole)
    return Receiver(_port(port, host, tcp, faults, sender, say), decoder, faults)


def require_osc() -> None:
    """Check that python-osc, which sends VMC, is installed.

    Raises:
        UsageError: it is not installed.
    """
    if importlib.util.find_spec("pythonosc") is None:
        raise UsageError(f"--send needs python-osc: {install_line('live')}")


def _floats(faults: FaultCounter, known: Skeleton | None, whole: bool) -> FloatDecoder:
    if known is None:
        raise UsageError("floats carry no names of joints: --skeleton FILE, a motion file that has them")
    return FloatDecoder(faults, known, whole)


def _port(
    port: int | None, host: str, tcp: bool, faults: FaultCounter, sender: str, say: Callable[[str], None]
) -> InputPort:
    if port is None:
        for given, option in ((tcp, "--tcp"), (bool(sender), "--sender")):
            if given:
                raise UsageError(f"{option} needs --port")
        return StdinPort()
    opening = (TcpPort if tcp else UdpPort)(host, port, faults, _address_of(sender))
    say(
        f"listening on {'TCP' if tcp else 'UDP'} {opening.address[0]}:{opening.address[1]}: {_who(opening.address[0], sender)}"
    )
    return opening


def _who(host: str, sender: str) -> str:
    """Return who may send, and the option that changes it."""
    if ipaddress.ip_address(host).is_loopback:
        return "this machine may send; --host 0.0.0.0 lets others"
    return f"{sender} may send" if sender else "any machine may send; --sender ADDRESS admits one only"


def _address_of(sender: str) -> str:
    """Return the address of a machine.

    Raises:
        UsageError: the name is not known.
    """
    try:
        return socket.gethostbyname(sender) if sender else ""
    except OSError as error:
        raise UsageError(f"--sender {sender}: {error.strerror or error}") from None


def _refuse_idle(source: str, port: int | None, tcp: bool, skeleton: Path | None, sender: str) -> None:
    if source not in HEADSETS and not Path(source.partition("#")[0]).exists():
        raise UsageError(f"--from {source!r} is neither a motion file nor one of {', '.join(SOURCES)}")
    received = {"--port": port is not None, "--tcp": tcp, "--skeleton": skeleton is not None, "--sender": bool(sender)}
    for option, given in received.items():
        if given:
            raise UsageError(
                f"{option} applies to received frames; {source} is a {'headset' if source in HEADSETS else 'file'}"
            )
