"""Damage files, TOML and packets at random and read them: everything ends in data or in a sentence, quickly and in little memory.

    python scripts/tools/fuzz.py --cases 20000 [--seeds FOLDER …] [--only TARGET …] [--keep FOLDER]

Each target is read in a process of its own, so that a crash of a library is seen. A case fails when it ends the process,
raises anything but an error of the package, takes longer than 5 s, or more than 1 GB of memory. Exit code 1 if one does.
"""

import argparse
import io
import json
import os
import pickle
import random
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SECONDS, MEGABYTES = 5.0, 1000
"""Most that one case may take."""
NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b"0",
    b"-1",
    b"1e400",
    b"1e200",
    b"-1e308",
    b"1" + b"0" * 400,
    b"4294967296",
    b"0.5",
    b"true",
    b"[]",
)
"""Put in the place of numbers in texts."""
Read = Callable[[Path], object]


@dataclass(frozen=True)
class Target:
    """A reader, and whole files that it reads."""

    read: Read
    seeds: tuple[Path, ...]


DEEPMIMIC = (4, 4, 4, 4, 1, 4, 4, 1, 4, 1, 4, 4, 1)
"""Numbers of the turns of its joints: quaternions and angles."""
TURNS = [number for count in DEEPMIMIC for number in ([1.0, 0, 0, 0] if count == 4 else [0.0])]

# What is damaged


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A file with one to three faults; in a zip, often inside of a member."""
    if data[:2] == b"PK" and rng.random() < 0.7:
        return _damaged_zip(data, rng)
    for _ in range(rng.choice((1, 1, 2, 3))):
        data = rng.choice(FAULTS)(data, rng)
    return data


def _damaged_zip(data: bytes, rng: random.Random) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        names = old.namelist()
        chosen = rng.choice(names)
        for name in names:
            content = old.read(name)
            new.writestr(name, damaged(content, rng) if name == chosen else content)
    return out.getvalue()


def _place(data: bytes, rng: random.Random) -> int:
    """A place in a file, in half of the cases near its beginning, where the structure is."""
    return rng.randrange(min(len(data), 512) if rng.random() < 0.5 else len(data)) if data else 0


def _flip(data: bytes, rng: random.Random) -> bytes:
    k = _place(data, rng)
    return data[:k] + bytes([(data[k] if data else 0) ^ (1 << rng.randrange(8))]) + data[k + 1 :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: _place(data, rng)]


def _drop(data: bytes, rng: random.Random) -> bytes:
    k = _place(data, rng)
    return data[:k] + data[k + rng.choice((1, 2, 4, 8, 100)) :]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    k = _place(data, rng)
    piece = data[k : k + rng.choice((1, 4, 40, 400))]
    return data[:k] + piece * rng.choice((2, 3, 50)) + data[k:]


def _noise(data: bytes, rng: random.Random) -> bytes:
    k, n = _place(data, rng), rng.choice((1, 2, 4, 8))
    return data[:k] + rng.choice((rng.randbytes(n), b"\xff" * n, b"\0" * n, b"[" * 3000)) + data[k + n :]


def _number(data: bytes, rng: random.Random) -> bytes:
    found = list(NUMBER.finditer(data[:20000]))
    if not found:
        return _noise(data, rng)
    one = rng.choice(found)
    return data[: one.start()] + rng.choice(NUMBERS) + data[one.end() :]


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines[: rng.choice((len(lines), a + 1))])


FAULTS = (_flip, _cut, _drop, _repeat, _noise, _number, _number, _line)


# What is read


def motion_target(folder: Path, more: list[Path]) -> Target:
    """All readers of human motion."""
    from robot_retarget.base.files import SAMPLES
    from robot_retarget.human.read import read_motion

    rng = np.random.default_rng(0)
    turns = {"poses": rng.normal(0, 0.1, (9, 66)), "trans": np.zeros((9, 3)), "betas": np.zeros(10), "fps": 30.0}
    text = (SAMPLES / "wave.bvh").read_text(encoding="utf-8")
    head, rows = text.split("Frame Time", 1)
    bvh = re.sub(r"Frames: *\d+", "Frames: 9", head) + "Frame Time" + "\n".join(rows.split("\n")[:10]) + "\n"
    (folder / "a.bvh").write_text(bvh, encoding="utf-8")
    (folder / "a.pkl").write_bytes(pickle.dumps(turns))
    np.savez(folder / "smpl.npz", **turns)  # pyright: ignore[reportArgumentType]
    np.savez_compressed(folder / "points.npz", positions=rng.normal(0, 1, (9, 22, 3)), fps=30)
    np.save(folder / "marks.npy", rng.normal(0, 1, (9, 33, 3)))
    features = np.zeros((9, 263))
    features[:, 4:67] = rng.normal(0, 0.4, 63)
    features[:, 67:193] = np.tile([1.0, 0, 0, 0, 1.0, 0], 21)
    np.save(folder / "features.npy", features)
    marks = [[{"x": float(x), "y": 0.1, "z": 1.0} for x in rng.normal(0, 1, 33)] for _ in range(4)]
    (folder / "marks.json").write_text(json.dumps({"fps": 30, "frames": [{"landmarks": one} for one in marks]}))
    frames = [[1 / 30, 0, 1, 0, *TURNS] for _ in range(4)]
    (folder / "deepmimic.txt").write_text(json.dumps({"Loop": "none", "Frames": frames}))
    with zipfile.ZipFile(folder / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.bvh", bvh)
    matrices = np.tile(np.eye(3), (9, 22, 1, 1))
    np.savez(
        folder / "turned.npz", positions=np.random.default_rng(0).normal(0, 1, (9, 22, 3)), rotations=matrices, fps=30
    )
    body = {"root_pos": np.zeros((9, 3), "f4"), "root_rot": np.tile([0, 0, 0, 1.0], (9, 1)), "fps": 30}
    body["joint_rot"] = np.tile([0, 0, 0, 1.0], (9, 14, 1))
    (folder / "parc.pkl").write_bytes(pickle.dumps({"motion_data": pickle.dumps(body)}))

    def sound(path: Path) -> object:
        """Read a motion; what is read is a body."""
        motion = read_motion(path)
        turns = motion.rotations if motion.rotations is not None else np.array([[1.0, 0, 0, 0]])
        if not (np.isfinite(motion.skeleton.offsets).all() and np.abs(motion.positions).max() < 1e4):
            raise AssertionError("offsets or places of no body")
        if np.abs(np.linalg.norm(turns, axis=-1) - 1).max() > 1e-3:
            raise AssertionError("rotations that are not unit")
        return motion

    return Target(sound, (*sorted(folder.iterdir()), *more))


def format_target(folder: Path, more: list[Path]) -> Target:
    """All formats of robot motion."""
    from robot_retarget.formats import FORMATS, FormatOptions, export, import_motion
    from robot_retarget.robot import load_robot
    from robot_retarget.trajectory import Trajectory

    robot = load_robot("op3")
    qpos = np.tile(robot.standing(), (9, 1))
    qpos[:, robot.qpos_index] += np.random.default_rng(0).normal(0, 0.05, (9, len(robot.joint_names)))
    moved = Trajectory(qpos, 30.0, robot.joint_names, "op3", "wave.bvh")
    for name, kind in FORMATS.items():
        path = export(moved, robot, name, folder / f"{name}{kind.suffix}", FormatOptions(fps=kind.fps))
        if (path / "keys.xml").exists():
            os.replace(path / "keys.xml", folder / "keys.xml")
    seeds = tuple(path for path in sorted(folder.iterdir()) if path.is_file() and not path.name.endswith(".json"))
    given = FormatOptions(source_fps=30.0)
    return Target(lambda path: import_motion(path, robot, path.stem if path.stem in FORMATS else None, given), seeds)


def toml_target(folder: Path, more: list[Path]) -> Target:
    """All TOML files and reports."""
    from robot_retarget.actuators.map import load_map
    from robot_retarget.base.files import MODELS, SAMPLES
    from robot_retarget.graph.edits import read_edits
    from robot_retarget.human.match import match
    from robot_retarget.human.read import read_motion
    from robot_retarget.judge.verdict import read_thresholds
    from robot_retarget.robot import load_robot
    from robot_retarget.robot.catalog import read_limits
    from robot_retarget.servo.foreign import read_foreign
    from robot_retarget.tools.batch.filters import SHIPPED, read_filters

    robot, motion = load_robot("op3"), read_motion(SAMPLES / "wave.bvh").frames(0, 2)
    texts = {
        "servos": (MODELS / "op3/servos.toml").read_text(encoding="utf-8"),
        "filters": SHIPPED.read_text(encoding="utf-8"),
        "limits": '[range]\nl_knee = [-1.0, 1.5]\n[speed]\n"*" = 5.0\n[torque]\nl_knee = 3.0\n',
        "map": '[human]\nl_hand = "LeftWrist"\n[robot]\nl_hand = ["l_el_link", 0, 0.1, 0]\nforward = [1, 0, 0]\n',
        "edits": '[[edge]]\na = "l_hand"\nb = "head"\nat = 0.05\nframes = [3, 9]\npriority = 2.0\n',
        "thresholds": "tracking_rms = 0.2\npenetration = 0.02\n",
        "robotis": "[ control info ]\ncontrol_cycle = 8\n[ port info ]\n/dev/ttyUSB0 | 2000000 | r_sho_pitch\n"
        "[ device info ]\ndynamixel | /dev/ttyUSB0 | 1 | XM430-W350 | 2.0 | r_sho_pitch | present_position\n",
    }
    readers: dict[str, Read] = {
        "servos": load_map,
        "filters": read_filters,
        "limits": read_limits,
        "map": lambda path: match(motion, robot, path),
        "edits": read_edits,
        "thresholds": read_thresholds,
        "robotis": read_foreign,
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return Target(lambda path: readers[path.stem](path), tuple(sorted(folder.iterdir())))


def robot_target(folder: Path, more: list[Path]) -> Target:
    """Robot models, MJCF and URDF."""
    from robot_retarget.robot import load_robot

    mjcf = """<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1"/>
<body name="leg"><joint name="knee" axis="0 1 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/>
</body></body></worldbody><actuator><position joint="knee" kp="30" forcerange="-5 5"/></actuator></mujoco>"""
    urdf = """<robot name="r"><link name="base"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0"
iyz="0"/></inertial><collision><geometry><box size=".1 .1 .1"/></geometry></collision></link><link name="leg"><inertial>
<origin xyz="0 0 -.2" rpy="0 0 0"/><mass value=".5"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="knee" type="revolute"><parent link="base"/><child link="leg"/><origin xyz="0 0 -.1" rpy="0 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint></robot>"""
    (folder / "r.xml").write_text(mjcf)
    (folder / "r.urdf").write_text(urdf)
    return Target(load_robot, tuple(sorted(folder.iterdir())))


def live_target(folder: Path, more: list[Path]) -> Target:
    """Packets of performers: VMC, lines of JSON."""
    from perform import PROTOCOLS

    from robot_retarget.base.files import SAMPLES
    from robot_retarget.human.read import read_motion
    from robot_retarget.live.frame import FaultCounter, RefusedError
    from robot_retarget.live.messages import LineDecoder
    from robot_retarget.live.receiver import Decoder
    from robot_retarget.live.vmc import VmcDecoder

    motion = read_motion(SAMPLES / "wave.bvh").frames(0, 4)
    for name, encoder in PROTOCOLS.items():
        packets = encoder(motion)
        (folder / f"{name}.bin").write_bytes(
            b"\0\0\0\0\0\0\0\0BREAK".join(p for t in range(4) for p in packets(t, t / 30))
        )

    def read(path: Path) -> None:
        faults = FaultCounter()
        makers: dict[str, Callable[[], Decoder]] = {
            "vmc": lambda: VmcDecoder(faults),
            "json": lambda: LineDecoder(faults, None, True),
        }
        decoder = makers[path.stem]()
        for k, packet in enumerate(path.read_bytes().split(b"\0\0\0\0\0\0\0\0BREAK")):
            try:
                if decoder.feed(packet, k / 120):
                    decoder.newest()
            except RefusedError as error:
                faults.refused(error)

    return Target(read, tuple(sorted(folder.iterdir())))


def servo_target(folder: Path, more: list[Path]) -> Target:
    """Packets on the servo bus: the parser, and all that the emulated servos answer."""
    from robot_retarget.actuators.control_tables import MODELS
    from robot_retarget.servo import protocol
    from robot_retarget.servo.emulator.device import Device
    from robot_retarget.servo.emulator.network import Network
    from robot_retarget.servo.protocol import BROADCAST, Instruction, Parser

    packets = [protocol.frame(1, kind, bytes((132, 0, 4, 0, 1, 2))) for kind in Instruction]
    packets += [protocol.frame(BROADCAST, kind, bytes((132, 0, 4, 0, 1, 2))) for kind in Instruction]
    packets += [protocol.sync_write(116, 4, [(1, bytes(4)), (2, bytes(4))]), protocol.write(1, 64, b"\1")]
    (folder / "packets.bin").write_bytes(b"".join(packets))

    def read(path: Path) -> None:
        devices = [Device(next(iter(MODELS.values()))) for _ in range(2)]
        devices[1].registers["id"] = 2
        network = Network(devices)
        rng = random.Random(len(path.read_bytes()))
        for frame in Parser().feed(path.read_bytes()):
            network.answer(frame)
            words = rng.choice((b"\xff\xff", b"\0\0", rng.randbytes(2))) + rng.choice((b"\xff\xff", rng.randbytes(2)))
            other = frame._replace(
                id=rng.choice((1, 2, BROADCAST)),
                instruction=rng.choice(list(Instruction)),
                params=words + rng.randbytes(rng.randrange(9)),
            )
            network.answer(other)
        for device in devices:
            device.control(1.0, 0.002, 12.0)

    return Target(read, tuple(sorted(folder.iterdir())))


TARGETS: dict[str, Callable[[Path, list[Path]], Target]] = {
    "motions": motion_target,
    "formats": format_target,
    "settings": toml_target,
    "robots": robot_target,
    "live": live_target,
    "servos": servo_target,
}


# How it is run


class _SlowError(BaseException):
    """A case took too long."""


def _too_slow(*_: object) -> None:
    raise _SlowError


def outcome(read: Read, path: Path) -> str:
    """Read a file: `read`, `refused`, or what went wrong."""
    from robot_retarget.base.errors import RobotRetargetError

    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, 4 * SECONDS)
    found = "read"
    try:
        read(path)
    except RobotRetargetError as error:
        found = "refused" if str(error).isprintable() else f"message of several lines: {str(error)[:80]!r}"
    except _SlowError:
        found = "slow"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        found = f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {str(error)[:80]}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    took, grown = time.process_time() - began, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    if took > SECONDS:
        return f"slow: {took:.1f} s ({found})"
    return f"memory: {grown // 1000} MB ({found})" if grown > MEGABYTES * 1000 else found


def cases(target: Target, first: int, last: int, folder: Path) -> Iterator[tuple[int, Path]]:
    """Damaged files, the same for the same number; the first ones are whole."""
    for number in range(first, last):
        rng = random.Random(number)
        seed = target.seeds[number % len(target.seeds)]
        path = folder / seed.name
        path.write_bytes(damaged(seed.read_bytes(), rng) if number >= len(target.seeds) else seed.read_bytes())
        yield number, path


def child(target: Target, first: int, last: int, folder: Path, pipe: int) -> None:
    """Run cases in this process; a line for each before it begins and after it ends."""
    signal.signal(signal.SIGVTALRM, _too_slow)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    np.seterr(all="ignore")
    warnings.simplefilter("ignore")
    for number, path in cases(target, first, last, folder):
        os.write(pipe, f"{number}\t".encode())
        os.write(pipe, f"{outcome(target.read, path)!s}\n".replace("\t", " ").encode(errors="replace"))
    os._exit(0)


def run(target: Target, count: int, folder: Path, keep: Path | None) -> dict[str, list[int]]:
    """Outcomes of the cases of a target, with their numbers."""
    found: dict[str, list[int]] = {}
    first = 0
    while first < count:
        reader, writer = os.pipe()
        process = os.fork()
        if process == 0:
            os.close(reader)
            child(target, first, count, folder, writer)
        os.close(writer)
        with os.fdopen(reader, encoding="utf-8", errors="replace") as lines:
            for line in lines:
                number, _, text = line.rstrip("\n").partition("\t")
                first = int(number) + 1
                found.setdefault(text or f"crash: {os.waitpid(process, 0)[1]}", []).append(int(number))
    if keep is not None:
        for text, numbers in found.items():
            if text not in ("read", "refused"):
                for number, path in cases(target, numbers[0], numbers[0] + 1, folder):
                    (keep / f"{number}-{path.name}").write_bytes(path.read_bytes())
    return found


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20000, help="of all targets together")
    parser.add_argument("--seeds", type=Path, nargs="*", default=[], help="folders with more files of human motion")
    parser.add_argument("--only", nargs="*", default=list(TARGETS), choices=TARGETS)
    parser.add_argument("--keep", type=Path, help="folder for the first file of each failure")
    given = parser.parse_args()
    more = [
        path
        for folder in given.seeds
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.stat().st_size < 1 << 20
    ]
    bad = 0
    with tempfile.TemporaryDirectory() as top:
        for name in given.only:
            folder, work = Path(top) / name, Path(top) / f"{name}-work"
            folder.mkdir()
            work.mkdir()
            target = TARGETS[name](folder, more if name == "motions" else [])
            found = run(target, given.cases // len(given.only), work, given.keep)
            counts = {text: len(numbers) for text, numbers in found.items()}
            print(
                f"{name}: {counts.pop('read', 0)} read, {counts.pop('refused', 0)} refused, {sum(counts.values())} failed",
                flush=True,
            )
            for text, count in sorted(counts.items()):
                print(f"  {count} × {text} (case {found[text][0]})", flush=True)
            bad += sum(counts.values())
    return min(bad, 1)


if __name__ == "__main__":
    sys.exit(main())
