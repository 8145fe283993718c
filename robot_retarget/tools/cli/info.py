"""`info`: describe a motion, a robot or a trajectory. `doctor`: examine the machine, with a cure for each missing part."""

import importlib
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer

import robot_retarget as rr
from robot_retarget.base.errors import DISTRIBUTION, RobotRetargetError, UsageError, extra_requirements, install_line
from robot_retarget.tools.cli import console
from robot_retarget.tools.cli import options as opt
from robot_retarget.tools.cli.command import argument, command, option, options
from robot_retarget.tools.cli.run import is_robot_name


@options
class InfoOptions(opt.SceneFileOptions):
    """The object to describe."""

    file: str | None = argument("A motion, a trajectory, an MJCF file or a robot's name.", default=None)
    robot: str | None = option("A robot, where its name is also a file's.", "--robot", "-r", default=None)


@command(epilog="Example: robot-retarget info dance.bvh")
def info(subject: InfoOptions, reading: opt.ReadOptions, limits: opt.LimitOptions, printing: opt.PrintOptions) -> None:
    """Describe a motion, a robot or a trajectory, with its keypoints.

    With a scene: its bodies too, and the parts that touch them.
    """
    from robot_retarget.tools.summary import (
        describe_motion,
        describe_robot,
        describe_scene,
        describe_terrain,
        describe_trajectory,
    )

    file, robot = str(subject.file), subject.robot
    if (subject.file is None) == (robot is None):
        raise UsageError("info takes one thing: a motion, an MJCF file, or --robot NAME")
    if robot is not None or is_robot_name(file):
        facts = describe_robot(opt.load(robot or file, limits.limits))
    elif opt.kind_of(Path(file)) == "trajectory":
        facts = describe_trajectory(rr.load_trajectory(file))
        printing.show(facts, lambda _: _show_trajectory(facts, file))
        return
    else:
        motion = reading.read(Path(file))
        facts = describe_motion(motion)
        if subject.scene is not None:
            from robot_retarget.human.surroundings import with_scene

            facts |= describe_scene(with_scene(motion, rr.read_scene(subject.scene)), opt.load(opt.DEFAULT_ROBOT))
        elif facts["human"]:
            facts |= describe_terrain(motion, opt.load(opt.DEFAULT_ROBOT))
    printing.show(facts, console.show_robot if facts["kind"] == "robot" else console.show_motion)
    if not facts.get("human", facts.get("humanoid", True)):
        raise typer.Exit(2)


def _show_trajectory(facts: dict[str, Any], file: str) -> None:
    """Print what `describe_trajectory` found."""
    rate = f"{facts['frames']} frames at {facts['fps']:g} fps ({facts['duration_s']:g} s)"
    console.say(f"{file}: a trajectory of {facts['source'] or 'an unnamed motion'} on {facts['robot']}: {rate}")
    goals = "with judged goals" if facts["judged_goals"] else "not simulated"
    console.say(f"{len(facts['joints'])} joints, balance {facts['balance']}, {goals}")
    for sentence in facts["notes"]:
        console.say(f"note: {sentence}")
    console.say(f"\nnext: robot-retarget view {file}")


@command(epilog="Example: robot-retarget doctor --json")
def doctor(printing: opt.PrintOptions) -> None:
    """Examine the machine, with a cure for each missing part.

    Python, MuJoCo, rendering, compiler, ffmpeg, extras, serial ports. Exit code 1 if a needed part is missing.
    """
    from dataclasses import asdict

    findings = examine()
    printing.show([asdict(finding) for finding in findings], lambda _: _show(findings))
    raise typer.Exit(1 if any(finding.state == "missing" for finding in findings) else 0)


def _show(findings: "list[ComponentStatus]") -> None:
    console.table("", ("part", "state", "detail"), [(f.part, f.state, f.detail) for f in findings])
    for finding in findings:
        if finding.cure and finding.state != "ok":
            console.say(f"{finding.part}: {finding.cure}")


OLDEST_PYTHON = (3, 11)
PORTS = ("ttyUSB*", "ttyACM*")
LATENCY_MS = 1
"""The latency timer of a USB adapter at which a bus keeps 125 ticks a second [ms]; drivers begin at 16."""
TIMERS = "sys/bus/usb-serial/devices"
EXTRAS = ("plots", "video", "view", "descriptions", "c3d", "formats")
"""Those that a user may want."""
MODULES = {
    "imageio-ffmpeg": "imageio_ffmpeg",
    "pillow": "PIL",
    "fast-simplification": "fast_simplification",
    "mcap-ros2-support": "mcap_ros2",
    "pyyaml": "yaml",
}
"""Distributions whose module has another name."""
PICTURE = 64
"""Width and height of the picture that rendering is tried with [pixels]."""


@dataclass(frozen=True)
class ComponentStatus:
    """One part of the machine."""

    part: str
    state: str
    """`ok`, `optional` (missing, and not needed by every command) or `missing`."""
    detail: str
    cure: str = ""
    """The command that repairs it; empty for a part that works."""


def examine(root: Path = Path("/")) -> list[ComponentStatus]:
    """Examine the machine.

    Args:
        root: The folder that holds `dev` and `sys`.
    """
    parts: tuple[Callable[[], ComponentStatus], ...] = (_python, _mujoco, _rendering, _compiler, _ffmpeg)
    return [*(part() for part in parts), *extras(), *ports(root)]


def _python() -> ComponentStatus:
    found = platform.python_version()
    if sys.version_info[:2] < OLDEST_PYTHON:
        wanted = ".".join(map(str, OLDEST_PYTHON))
        return ComponentStatus("Python", "missing", f"{found} is older than {wanted}", f"install Python {wanted}")
    return ComponentStatus("Python", "ok", f"{found} at {sys.executable}")


def _mujoco() -> ComponentStatus:
    from robot_retarget.base.mujoco_setup import OLDEST, check

    cure = f"pip install 'mujoco>={'.'.join(map(str, OLDEST))}'"
    try:
        found = version("mujoco")
        check(found)
        importlib.import_module("mujoco")
    except PackageNotFoundError:
        return ComponentStatus("MuJoCo", "missing", "not installed", cure)
    except (RobotRetargetError, ImportError, RuntimeError) as error:
        return ComponentStatus("MuJoCo", "missing", str(error), cure)
    return ComponentStatus("MuJoCo", "ok", found)


def _rendering() -> ComponentStatus:
    from robot_retarget.tools.view.picture import Unavailable
    from robot_retarget.tools.view.render import open_context

    context = open_context(PICTURE, PICTURE)
    if isinstance(context, Unavailable):
        cure = "sudo apt install libegl1; unset MUJOCO_GL; without EGL: sudo apt install libosmesa6; export MUJOCO_GL=osmesa"
        return ComponentStatus("OpenGL", "optional", f"{context.reason}; pictures are drawn as stick figures", cure)
    context.free()
    return ComponentStatus("OpenGL", "ok", f"pictures are rendered by {type(context).__module__}")


def _compiler() -> ComponentStatus:
    found = shutil.which(os.environ.get("CC", "cc"))
    if found is None:
        detail = "neither $CC nor cc is on the path; everything runs, and solving takes about a quarter longer"
        return ComponentStatus("C compiler", "optional", detail, "sudo apt install gcc libc6-dev")
    return ComponentStatus("C compiler", "ok", found)


def _ffmpeg() -> ComponentStatus:
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return ComponentStatus("ffmpeg", "ok", get_ffmpeg_exe())
    except (ImportError, RuntimeError) as error:
        return ComponentStatus("ffmpeg", "optional", f"{error}; films cannot be made", install_line("video"))


def extras() -> Iterator[ComponentStatus]:
    """Whether each extra is installed, by the modules of its distributions."""
    for extra in EXTRAS:
        names = [re.split(r"[^\w-]", line)[0].lower() for line in extra_requirements(extra)]
        lost = [name for name in names if find_spec(MODULES.get(name, name.replace("-", "_"))) is None]
        if not names or lost:
            detail = f"without {', '.join(lost)}" if names else f"unknown: {DISTRIBUTION} is not installed"
            yield ComponentStatus(f"extra {extra}", "optional", detail, install_line(extra))
        else:
            yield ComponentStatus(f"extra {extra}", "ok", ", ".join(names))


def ports(root: Path) -> Iterator[ComponentStatus]:
    """Serial ports: whether the user may open them, and the latency timers of their adapters."""
    found = [port for pattern in PORTS for port in sorted((root / "dev").glob(pattern))]
    if not found:
        yield ComponentStatus("serial port", "optional", "no USB adapter is plugged in; `servos emulate` needs none")
    for port in found:
        if os.access(port, os.R_OK | os.W_OK):
            yield ComponentStatus(f"port {port.name}", "ok", "may be read and written")
        else:
            cure = f'sudo usermod -aG {_group(port)} "$USER", then log in again'
            yield ComponentStatus(f"port {port.name}", "missing", "may not be opened by this user", cure)
        yield from _latency(root / TIMERS / port.name / "latency_timer", port.name)


def _latency(timer: Path, port: str) -> Iterator[ComponentStatus]:
    try:
        milliseconds = int(timer.read_text())
    except (OSError, ValueError):
        return  # adapters of other makers have none
    part = f"latency of {port}"
    if milliseconds <= LATENCY_MS:
        yield ComponentStatus(part, "ok", f"{milliseconds} ms")
    else:
        cure = f"echo {LATENCY_MS} | sudo tee {timer}"
        yield ComponentStatus(part, "missing", f"{milliseconds} ms allow {500 // milliseconds} ticks/s", cure)


def _group(port: Path) -> str:
    """The group that owns a port."""
    try:
        return port.group()
    except (KeyError, OSError):
        return "dialout"
