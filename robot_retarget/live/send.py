"""A motion sent as a performer would send it: for trying out a stream without a phone, a headset or a suit."""

import socket
import time
from collections.abc import Callable, Iterator
from itertools import count
from threading import Event
from urllib.parse import urlsplit

from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from robot_retarget.base.errors import UsageError, known
from robot_retarget.human.motion import Motion
from robot_retarget.live.bones import humanoid, unity_place, unity_turn
from robot_retarget.live.messages import line_of, skeleton_line
from robot_retarget.live.vmc import BONE, OK, PORT, ROOT, TIME

Packets = Callable[[int, float], list[bytes]]
"""Returns the packets of a frame, given its number and time stamp [s]."""
AGAIN = 1.0
"""Interval at which the skeleton is sent again for receivers that start later [s]."""
BONES_AT_ONCE = 12
"""Bones of one packet; it fits an Ethernet frame."""


def sending(motion: Motion, target: str) -> tuple[Packets, tuple[str, int]]:
    """Return the encoder and the address of a target: `vmc://HOST:PORT` or `json://HOST:PORT`.

    Raises:
        UsageError: the target is invalid, or the motion lacks the rotations that the protocol needs.
        MatchError: VMC is for humans, and the motion is not human.
    """
    try:
        parts = urlsplit(target)
        port = parts.port
    except ValueError:
        raise UsageError(f"--to {target}: the port must be a number from 0 to 65535") from None
    if parts.scheme not in PROTOCOLS or not parts.hostname:
        raise UsageError(f"--to {target!r} is no target; {known(f'{name}://HOST:PORT' for name in PROTOCOLS)}")
    if port is None and parts.scheme != "vmc":
        raise UsageError(f"--to {target} needs a port")
    if motion.scene is not None and parts.scheme != "json":
        raise UsageError(f"{parts.scheme} carries no bodies; json:// does")
    return PROTOCOLS[parts.scheme](motion), (parts.hostname, PORT if port is None else port)


def send(
    motion: Motion,
    target: str,
    speed: float = 1.0,
    seconds: float | None = None,
    stop: Event | None = None,
    began: float | None = None,
) -> dict[str, float]:
    """Send a motion over UDP in real time: once, or forth and back for `seconds`.

    Time stamps count from now, or from `began` on the monotonic clock [s].

    Returns:
        the number of frames sent, and the duration [s].

    Raises:
        UsageError: as `sending`; the speed is not positive; or sending fails.
    """
    if not 0 < speed < float("inf"):
        raise UsageError(f"--speed must be positive, got {speed:g}")
    packets, address = sending(motion, target)
    stop, period, start = stop or Event(), 1 / (motion.fps * speed), time.monotonic()
    began = start if began is None else began
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        sent = 0
        for sent, t in enumerate(_order(len(motion), seconds is None)):
            now = time.monotonic()
            if stop.wait(max(start + sent * period - now, 0.0)) or (seconds is not None and now - start >= seconds):
                break
            try:
                for packet in packets(t, time.monotonic() - began):
                    out.sendto(packet, address)
            except ConnectionRefusedError:
                pass  # no receiver yet
            except OSError as error:
                raise UsageError(f"cannot send to {target}: {error}") from error
        else:
            sent += 1
    return {"frames": sent, "seconds": round(time.monotonic() - start, 2)}


def _order(frames: int, once: bool) -> Iterator[int]:
    """Yield 0 … T − 1 once, or forth and back forever."""
    if once or frames == 1:
        yield from range(frames) if once else (0 for _ in count())
        return
    for k in count():
        turn = k % (2 * frames - 2)
        yield min(turn, 2 * frames - 2 - turn)


def _vmc(motion: Motion) -> Packets:
    bones = humanoid(motion)

    def packets(t: int, time: float) -> list[bytes]:
        still = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        messages = [(ROOT, ["root", *still])]
        messages += [
            (BONE, [name, *unity_place(bones.places[t, k]), *unity_turn(bones.turns[t, k])])
            for k, name in enumerate(bones.names)
        ]
        messages += [(OK, [1]), (TIME, [time])]
        return [_bundle(messages[k : k + BONES_AT_ONCE]).dgram for k in range(0, len(messages), BONES_AT_ONCE)]

    return packets


def _bundle(messages: list[tuple[str, list[str | float | int]]]) -> OscBundle:
    bundle = OscBundleBuilder(IMMEDIATELY)
    for address, values in messages:
        message = OscMessageBuilder(address)
        for value in values:
            message.add_arg(value, "f" if isinstance(value, float) else None)
        bundle.add_content(message.build())
    return bundle.build()


def _lines(motion: Motion) -> Packets:
    skeleton = skeleton_line(motion.skeleton)
    messages = float("-inf")

    def packets(t: int, time: float) -> list[bytes]:
        nonlocal messages
        first = time - messages >= AGAIN
        messages = time if first else messages
        turns = None if motion.rotations is None else motion.rotations[t]
        line = line_of(time, motion.positions[t], turns, motion.poses_at(t))
        return [skeleton, line] if first else [line]

    return packets


PROTOCOLS: dict[str, Callable[[Motion], Packets]] = {"vmc": _vmc, "json": _lines}
