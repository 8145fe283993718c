"""Send a motion as a performer would, over VMC or as lines of JSON: for trying out a stream without a phone, a headset or a suit.

    python scripts/bench/perform.py samples/wave.bvh vmc://127.0.0.1 --fps 60 --seconds 60

Needs python-osc.
"""

import argparse
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from threading import Event
from urllib.parse import urlsplit

import numpy as np
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError, known
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.recognition import Recognition
from robot_retarget.human.skeleton import backward
from robot_retarget.live.bones import BONES, OPTIONAL, carriers
from robot_retarget.live.messages import line_of, skeleton_line
from robot_retarget.live.vmc import BONE, OK, ROOT, TIME, VMC_PORT

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
        raise UsageError(f"{target}: the port must be a number from 0 to 65535") from None
    if parts.scheme not in PROTOCOLS or not parts.hostname:
        raise UsageError(f"{target!r} is no target; {known(f'{name}://HOST:PORT' for name in PROTOCOLS)}")
    if port is None and parts.scheme != "vmc":
        raise UsageError(f"{target} needs a port")
    if motion.scene is not None and parts.scheme != "json":
        raise UsageError(f"{parts.scheme} carries no bodies; json:// does")
    return PROTOCOLS[parts.scheme](motion), (parts.hostname, VMC_PORT if port is None else port)


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
        raise UsageError(f"the speed must be positive, got {speed:g}")
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


def unity_place(p: Sequence[float] | Floats) -> list[float]:
    """The inverse of `place_of`."""
    return [float(-p[1]), float(p[2]), float(p[0])]


def unity_turn(q: Sequence[float] | Floats) -> list[float]:
    """The inverse of `turn_of`."""
    return [float(q[2]), float(-q[3]), float(-q[1]), float(q[0])]


_LIMBS = {
    "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "hand",
    "UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "Toes": "toe",
}  # fmt: skip
_TRUNK = {"Neck": "neck", "Head": "head"}


@dataclass(frozen=True, eq=False)
class HumanoidMotion:
    """The pose of each bone in what carries it, the hips' in the world; as `BONES` has them."""

    names: tuple[str, ...]
    places: Floats
    """(T, B, 3) [m]."""
    turns: Floats
    """(T, B, 4) unit w x y z."""


def humanoid(motion: Motion) -> HumanoidMotion:
    """The bones of a motion.

    Raises:
        UsageError: it has positions only, or a bone that a VRM must have is not among its joints.
        MatchError: it is not human.
    """
    if motion.rotations is None:
        raise UsageError(f"{motion.source or 'the motion'} has positions only: bones have rotations; send it as json")
    joints = _joints(motion.recognition, motion)
    lacking = [bone for bone in BONES if bone not in joints and bone not in OPTIONAL]
    if lacking:
        raise UsageError(f"{motion.source or 'the motion'} has no joint for {lacking[0]}")
    above = carriers(joints)
    names = tuple(above)
    parents = np.array([names.index(above[name]) if above[name] else -1 for name in names])
    chosen = [joints[name] for name in names]
    return HumanoidMotion(names, *backward(parents, motion.positions[:, chosen], motion.rotations[:, chosen]))


def _joints(recognition: Recognition, motion: Motion) -> dict[str, int]:
    """Return the joint of each bone; each joint serves one bone at most."""
    marks, above = recognition.marks, motion.skeleton.above
    legs = [marks[f"{side}_hip"].joints[0] for side in "lr"]
    head = marks["head" if "head" in marks else "neck"].joints[0]
    common = set.intersection(*(set(above(joint)[1:]) for joint in (*legs, head)))
    trunk = [joint for joint in reversed(above(head)[1:]) if joint > max(common, default=0)]
    found = {"Hips": max(common, default=0)}
    found |= {bone: marks[keypoint].joints[0] for bone, keypoint in _TRUNK.items() if keypoint in marks}
    spine = [joint for joint in trunk if joint not in found.values()]
    found |= dict(
        zip(("Spine", "Chest", "UpperChest"), [*spine[:2], *spine[-1:]] if len(spine) > 2 else spine, strict=False)
    )
    for side, letter in (("Left", "l"), ("Right", "r")):
        found |= {
            side + bone: marks[f"{letter}_{keypoint}"].joints[0]
            for bone, keypoint in _LIMBS.items()
            if f"{letter}_{keypoint}" in marks
        }
        collar = int(motion.skeleton.parents[found[f"{side}UpperArm"]])
        if collar not in found.values() and collar not in above(head):
            found[f"{side}Shoulder"] = collar
    return found


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


def main() -> None:
    """Send until the motion ends, the time is over or Ctrl-C."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("motion", help="motion file")
    ask.add_argument("target", help="vmc://HOST[:PORT] or json://HOST:PORT")
    ask.add_argument("--fps", type=float, help="frames a second; by default the motion's own")
    ask.add_argument("--speed", type=float, default=1.0, help="times its own speed")
    ask.add_argument("--seconds", type=float, help="forth and back for this time")
    given = ask.parse_args()
    motion = read_motion(given.motion)
    print(send(motion if given.fps is None else motion.resample(given.fps), given.target, given.speed, given.seconds))


if __name__ == "__main__":
    main()
