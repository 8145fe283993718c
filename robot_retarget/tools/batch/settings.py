"""The options that determine outputs, and the limits of a clip."""

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from robot_retarget import __version__


@dataclass(frozen=True)
class Settings:
    """How clips are retargeted. Two runs with equal settings, robots and clips write equal bytes."""

    fps: float | None = None
    """Frames per second of the trajectories; None takes each motion's own, 30 at most."""
    preset: str = "balanced"
    legs: str = "auto"
    balance: str = "off"
    frames: str | None = None
    """The part of every clip that is used, `START:STOP` (`motion.span.part_of`)."""
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

    def digest(self, robot_sha256: str) -> str:
        """The sha256 of the settings, of the keypoint map, of the robot (`robot.model.digest`) and of this package's version."""
        values = asdict(self) | {name: None for name in ("map_file", "limits")}
        named = sha256_of(Path(self.map_file)) if self.map_file else ""
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
