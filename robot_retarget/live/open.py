"""A source by its name."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

from robot_retarget.errors import UsageError, install_line
from robot_retarget.live.faults import Faults
from robot_retarget.live.ports import Port, StdinPort, TcpPort, UdpPort
from robot_retarget.live.protocols.floats import FloatDecoder
from robot_retarget.live.protocols.lines import LineDecoder
from robot_retarget.live.receiver import Receiver, Source
from robot_retarget.live.replay import Replay
from robot_retarget.motion import Skeleton, read_motion

RECEIVED = ("vmc", "json", "floats")


def opened(
    source: str,
    port: int | None = None,
    host: str = "0.0.0.0",
    tcp: bool = False,
    skeleton: Path | None = None,
    speed: float = 1.0,
    say: Callable[[str], None] = lambda text: None,
) -> Source:
    """A source that listens, or plays a motion file.

    Args:
        source: `vmc`, `json`, `floats` or the path of a motion file.
        port: where to listen; VMC's own, or standard input for the others, by default.
        host: the address to listen at.
        tcp: a connection in place of datagrams.
        skeleton: a motion file whose joints those of `floats` are, and those of `json` until it tells others.
        speed: of a motion file.
        say: is told of faults.

    Raises:
        UsageError: what was asked for does not go together, python-osc is missing, or the port cannot be used.
        MotionError: a motion file cannot be read.
    """
    faults = Faults(say)
    if source not in RECEIVED:
        _refuse_idle(source, port, tcp, skeleton)
        return Replay(read_motion(source), faults, speed)
    known = None if skeleton is None else read_motion(skeleton).skeleton
    if source == "vmc":
        require_osc()
        from robot_retarget.live.protocols.vmc import PORT, VmcDecoder

        if tcp or known:
            raise UsageError("vmc is UDP and tells its bones itself: leave --tcp and --skeleton")
        return Receiver(UdpPort(host, PORT if port is None else port, faults), VmcDecoder(faults), faults)
    whole = port is not None and not tcp
    decoder = LineDecoder(faults, known, whole) if source == "json" else _floats(faults, known, whole)
    return Receiver(_port(port, host, tcp, faults), decoder, faults)


def require_osc() -> None:
    """VMC needs python-osc.

    Raises:
        UsageError: it is not installed.
    """
    if importlib.util.find_spec("pythonosc") is None:
        raise UsageError(f"VMC needs python-osc: {install_line('live')}")


def _floats(faults: Faults, known: Skeleton | None, whole: bool) -> FloatDecoder:
    if known is None:
        raise UsageError("floats carry no names of joints: --skeleton FILE, a motion file that has them")
    return FloatDecoder(faults, known, whole)


def _port(port: int | None, host: str, tcp: bool, faults: Faults) -> Port:
    if port is None:
        if tcp:
            raise UsageError("--tcp needs --port")
        return StdinPort()
    return TcpPort(host, port, faults) if tcp else UdpPort(host, port, faults)


def _refuse_idle(source: str, port: int | None, tcp: bool, skeleton: Path | None) -> None:
    if not Path(source.partition("#")[0]).exists():
        raise UsageError(f"--from {source!r} is neither a motion file nor one of {', '.join(RECEIVED)}")
    for given, option in ((port is not None, "--port"), (tcp, "--tcp"), (skeleton is not None, "--skeleton")):
        if given:
            raise UsageError(f"{option} is for what is received; {source} is a file")
