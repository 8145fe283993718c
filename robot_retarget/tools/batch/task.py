"""One clip onto one robot: the work that every engine does alike."""

import hashlib
import json
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_retarget import __version__
from robot_retarget.base.choices import Balance, Legs, Preset
from robot_retarget.base.errors import OutputError, RobotRetargetError
from robot_retarget.base.files import folder

# The options that determine outputs, and the limits of a clip.


@dataclass(frozen=True)
class Settings:
    """How clips are retargeted. Two runs with equal settings, robots and clips write equal bytes."""

    fps: float | None = None
    """Frames per second of the trajectories; None takes each motion's own, 30 at most."""
    preset: Preset = "balanced"
    legs: Legs = "auto"
    balance: Balance = "off"
    frames: str | None = None
    """The part of every clip that is used, `START:STOP` (`human.motion.part_of`)."""
    up: str | None = None
    repair: bool = True
    formats: tuple[str, ...] = ()
    """Additional formats."""
    mirror: bool = False
    """Whether the robot's mirror image of every trajectory is written too."""
    map_file: str | None = None
    limits: str | None = None
    freeze: tuple[str, ...] = ()
    """Joints that keep an angle (`robot.override.freeze`)."""
    only: str | None = None
    stand: float = 0.0
    """Time of a way from and into the standing pose at the ends [s]; figures are those of the motion between them."""

    def digest(self, robot_sha256: str) -> str:
        """The sha256 of what makes a trajectory: settings, the files that they name, the robot and this package's version.

        Further formats and mirror images are written from the trajectory.
        """
        values = asdict(self) | dict.fromkeys(("map_file", "limits", "formats", "mirror"))
        files = [self.map_file, *(word.partition("=")[2] for word in self.freeze)]
        named = [sha256_of(Path(file)) for file in files if file and Path(file).is_file()]
        return hashlib.sha256(
            json.dumps([values, named, robot_sha256, __version__], sort_keys=True).encode()
        ).hexdigest()


@dataclass(frozen=True)
class Allowance:
    """Limits of one clip."""

    seconds: float = 3600.0
    """Of wall time; a worker that takes longer is ended [s]."""
    memory: float = 2.0
    """Of resident memory; a worker that takes more is ended [GiB]."""
    attempts: int = 3
    """How often a clip is tried whose worker is killed from outside."""


@dataclass(frozen=True)
class Shard:
    """Every `count`-th clip, from `index` on."""

    index: int = 0
    count: int = 1

    def __contains__(self, number: int) -> bool:
        return number % self.count == self.index


@dataclass(frozen=True)
class Job:
    """One run of `batch`."""

    folders: tuple[Path, ...]
    robots: tuple[str, ...]
    out: Path
    settings: Settings = field(default_factory=Settings)
    allowance: Allowance = field(default_factory=Allowance)
    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    shard: Shard = field(default_factory=Shard)
    retry: tuple[str, ...] = ()
    """States that are tried again: `failed`, `timeout`, `memory`, `crashed`."""


def sha256_of(path: Path) -> str:
    """The sha256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


if TYPE_CHECKING:
    from robot_retarget.robot import Robot
    from robot_retarget.trajectory import Trajectory

DONE, FAILED, TIMEOUT, MEMORY, CRASHED = "done", "failed", "timeout", "memory", "crashed"
UNWRITABLE = "unwritable"
"""The outcome of a task whose output cannot be written: it ends the run and is not kept."""
MIRROR = "_mirror"
"""Ends the names of mirrored outputs."""


@dataclass(frozen=True)
class Task:
    """A clip and a robot, and where the outputs go."""

    path: str
    clip: str
    robot: str
    """As the user names it."""
    robot_name: str
    """The folder of its outputs."""
    digest: str
    """Of the clip, the robot and the settings."""
    out: str
    settings: Settings
    kept: "Row | None" = field(default=None, compare=False)
    """Row of a trajectory that stays, where only further files are missing."""

    @property
    def output(self) -> Path:
        """The trajectory's file."""
        return Path(self.out) / self.robot_name / f"{self.clip}.npz"

    def further(self) -> Iterator[tuple[str, str, Path]]:
        """Yield the files next to the trajectory: suffix of the name (for a mirror image), format, path."""
        from robot_retarget.formats import FORMATS

        for ending in ("", MIRROR) if self.settings.mirror else ("",):
            if ending:
                yield ending, "", self.output.with_name(f"{self.output.stem}{ending}.npz")
            for format in self.settings.formats:
                name = f"{self.clip}{ending}{FORMATS[format].suffix}"
                yield ending, format, Path(self.out) / f"{self.robot_name}-{format}" / name


@dataclass(frozen=True)
class Row:
    """One clip on one robot: a row of the manifest."""

    robot: str
    clip: str
    digest: str
    state: str
    message: str = ""
    """The reason of a failure; the remarks of reading and solving otherwise."""
    frames: int = 0
    fps: float = 0.0
    figures: dict[str, Any] = field(default_factory=dict)
    output_sha256: str = ""
    path: str = ""

    @property
    def key(self) -> tuple[str, str]:
        """The primary key."""
        return self.robot, self.clip


@dataclass(frozen=True)
class TaskResult(Row):
    """The result of a task; the facts of its clip follow."""

    seconds: float = 0.0
    peak_mb: float = 0.0
    """Peak memory of its process [MB]."""


def perform(task: Task) -> TaskResult:
    """Read, retarget, score and write one clip. A failure is an outcome, not an exception."""
    began = time.perf_counter()
    state, message, made = DONE, "", {}
    try:
        made = _made(task)
    except OutputError as error:
        state, message = UNWRITABLE, str(error)
    except RobotRetargetError as error:
        state, message = FAILED, str(error)
    except MemoryError:
        state, message = MEMORY, "out of memory"
    except Exception as error:  # a defect of one clip must not end thousands of others
        state, message = FAILED, f"a defect of robot-retarget: {type(error).__name__}: {error}"
    blank = TaskResult(task.robot_name, task.clip, task.digest, state, message)
    return replace(blank, **made, seconds=round(time.perf_counter() - began, 3), peak_mb=peak_memory())


def peak_memory() -> float:
    """Peak resident memory of this process [MB]."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(used / (1e6 if sys.platform == "darwin" else 1e3), 1)


def _made(task: Task) -> dict[str, Any]:
    """The fields of the outcome of a clip that could be done; its files are written."""
    from robot_retarget.edit.stands import between_stands
    from robot_retarget.human.motion import part_of
    from robot_retarget.human.read import read_motion
    from robot_retarget.robot import freeze
    from robot_retarget.scores.score import score
    from robot_retarget.solver.pipeline import retarget
    from robot_retarget.trajectory import load_trajectory

    settings = task.settings
    if task.kept is not None:
        trajectory = load_trajectory(task.output)
        _write_further(task, trajectory, robot_of(task.robot, settings.limits))
        return {name: getattr(task.kept, name) for name in ("message", "frames", "fps", "figures", "output_sha256")}
    robot = freeze(robot_of(task.robot, settings.limits), settings.freeze, settings.only)
    motion = part_of(read_motion(task.path, up=settings.up, repair=settings.repair), settings.frames)
    result = retarget(
        motion,
        robot,
        fps=settings.fps,
        overrides=settings.map_file,
        preset=settings.preset,
        legs=settings.legs,
        balance=settings.balance,
    )
    trajectory = result.trajectory
    found = score(trajectory, robot, motion, overrides=settings.map_file)
    trajectory = between_stands(trajectory, robot, settings.stand)
    write(task, trajectory, robot)
    return {
        "message": " ".join(result.notes),
        "frames": len(trajectory),
        "fps": trajectory.fps,
        "figures": dict(found.figures),
        "output_sha256": sha256_of(task.output),
    }


@lru_cache(maxsize=8)
def robot_of(name: str, limits: str | None) -> "Robot":
    """The robot, loaded once per process."""
    from robot_retarget.robot import load_robot

    return load_robot(name, limits)


def write(task: Task, trajectory: "Trajectory", robot: "Robot") -> None:
    """Write the trajectory and its further files; every file whole or not at all."""
    folder(task.output.parent)
    trajectory.save(task.output)
    _write_further(task, trajectory, robot)


def _write_further(task: Task, trajectory: "Trajectory", robot: "Robot") -> None:
    """Write the other formats and the mirror images of a trajectory."""
    from robot_retarget.edit.cuts import mirrored
    from robot_retarget.formats import export

    for ending, format, place in task.further():
        take = mirrored(trajectory, robot) if ending else trajectory
        folder(place.parent)
        export(take, robot, format, place) if format else take.save(place)
