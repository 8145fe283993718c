"""A file to be read, each part once and on demand; the JSON file next to it; and the definition of a format."""

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import FileError, TrajectoryError
from robot_retarget.base.untrusted.arrays import load_npz, rate_of
from robot_retarget.base.untrusted.documents import read_json
from robot_retarget.base.untrusted.limits import LZ4_MAGIC, file_bytes, is_zip
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.formats.columns import ArrayKeys, Columns, holds, keyed
from robot_retarget.formats.robot_motion import FormatOptions, RobotMotion
from robot_retarget.robot.model import Robot
from robot_retarget.trajectory import Trajectory

KEYS = ("format", "robot", "joint_names", "quaternion", "fps", "sha256")


def sidecar_path(path: Path) -> Path:
    """Where the JSON file of a file stands."""
    return path.with_name(path.name + ".json")


def sidecar_text(motion: RobotMotion, format: str, quaternion: str, written: Path) -> str:
    """The JSON text about a file just written."""
    return (
        json.dumps(
            {
                "format": format,
                "robot": motion.robot.name,
                "joint_names": list(motion.joints),
                "quaternion": quaternion,
                "fps": motion.fps,
                "frames": len(motion),
                "sha256": _hash(written),
            },
            indent=1,
        )
        + "\n"
    )


def read_sidecar(path: Path) -> dict[str, Any] | None:
    """The description in the JSON file next to a file; None if absent, or of another program.

    Raises:
        TrajectoryError: it is broken, or its sha256 is that of another content.
    """
    where = sidecar_path(path)
    if not (path.is_file() and where.is_file()):
        return None
    facts = read_json(where, TrajectoryError)
    try:
        complete = all(key in facts for key in KEYS) and all(isinstance(name, str) for name in facts["joint_names"])
    except TypeError as error:
        raise TrajectoryError(f"{where}: not the description of a motion file: {error}") from error
    if not complete:
        return None
    if facts["sha256"] != _hash(path):
        raise TrajectoryError(
            f"{path} is not the file that {where.name} describes: it was cut or changed since. "
            f"Remove {where.name} to read it all the same"
        )
    return facts


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


PICKLES = (".pkl", ".pickle", ".p", ".joblib", ".lz4", ".motion", ".pt")


@dataclass(frozen=True)
class TrajectorySource:
    """A file or folder, the robot it is to move, and the user's options."""

    path: Path
    robot: Robot
    options: FormatOptions = field(default_factory=FormatOptions)

    @cached_property
    def sidecar(self) -> dict[str, Any] | None:
        """The description in the JSON file next to it."""
        return read_sidecar(self.path)

    @cached_property
    def arrays(self) -> Mapping[str, np.ndarray]:
        """The plain arrays of an `.npz` or another ZIP file, each read on first access; empty for other files."""
        packed = self.path.is_file() and (self.path.suffix == ".npz" or is_zip(self.path))
        return load_npz(self.path) if packed else {}

    @cached_property
    def pickled(self) -> Any:
        """The contents of a pickle, of Python, joblib or PyTorch; None of any other file.

        Raises:
            FileError: it is broken, or would make anything but data.
        """
        return load_pickle(self.path) if self._looks_pickled() else None

    @cached_property
    def text(self) -> str:
        """The text of a text file; empty of any other file."""
        data = b"" if self.path.is_dir() else file_bytes(self.path)
        try:
            return "" if b"\0" in data[:4096] else data.decode("utf-8-sig").replace("\r\n", "\n")
        except UnicodeDecodeError:
            return ""

    @property
    def head(self) -> str:
        """The first line of a text file."""
        return self.text.split("\n", 1)[0]

    def array(self, key: str) -> np.ndarray:
        """An array of an `.npz` by its key.

        Raises:
            FileError: the archive lacks the key.
        """
        if key not in self.arrays:
            raise FileError(f"no array {key!r}; it has {', '.join(self.arrays) or 'none'}")
        return self.arrays[key]

    @property
    def rate(self) -> float | None:
        """Frames per second of an `.npz`, under any of their names; None if absent.

        Raises:
            FileError: they are not one positive number.
        """
        return rate_of(self.arrays)

    def names(self, key: str = "joint_names") -> tuple[str, ...] | None:
        """Names in an `.npz`, or in the JSON file next to it; None if absent."""
        value = self.arrays.get(key)
        if value is not None and value.dtype.kind == "U":
            return tuple(map(str, value.tolist()))
        return tuple(self.sidecar["joint_names"]) if self.sidecar else None

    @property
    def sidecar_fps(self) -> float | None:
        """Frames per second in the JSON file next to it [1/s]; None without one."""
        return float(self.sidecar["fps"]) if self.sidecar else None

    def _looks_pickled(self) -> bool:
        if not self.path.is_file():
            return False
        with self.path.open("rb") as stream:
            start = stream.read(4)
        return start[:1] == b"\x80" or start == LZ4_MAGIC or self.path.suffix.lower() in PICKLES


ROWS: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("formats.toml").read_text(encoding="utf-8"))
"""Facts of each format, which that file explains."""


@dataclass(frozen=True)
class TrajectoryFormat:
    """One kind of file that holds the motion of a robot; `formats.toml` explains the facts."""

    name: str
    write: Callable[[RobotMotion, Path], None]
    """Writes the file or folder; raises UsageError when the robot does not suit the format."""
    read: Callable[[TrajectorySource], Columns | Trajectory]
    """Reads it; raises TrajectoryError when it is not as the format has it."""
    claims: Callable[[TrajectorySource], bool]
    """Whether a file looks as if it were of this format."""
    suffix: str
    description: str
    readers: str
    fps: float | None = None
    """[1/s]."""
    complete: bool = True
    ordered: bool = False
    exact: bool = True
    plain: bool = False
    quaternion: str = "wxyz"
    bodies: bool = False

    @property
    def root(self) -> bool:
        """Whether the file holds the pose of the root."""
        return self.quaternion != "none"


def declared(
    name: str,
    write: Callable[[RobotMotion, Path], None],
    read: Callable[[TrajectorySource], Columns | Trajectory],
    claims: Callable[[TrajectorySource], bool],
) -> TrajectoryFormat:
    """Return a format of `formats.toml` with its functions."""
    return TrajectoryFormat(name, write, read, claims, **ROWS[name])


def declared_by_keys(
    name: str, write: Callable[[RobotMotion, Path], None], table: str, keys: ArrayKeys, *named: str
) -> TrajectoryFormat:
    """Return a format whose file is a dictionary with the arrays of root and joints.

    Args:
        table: the property of a source that holds the dictionary: `arrays` or `pickled`.
        named: keys of the names of the joints, and of what else the file has.
    """
    return declared(
        name,
        write,
        lambda source: keyed(getattr(source, table), keys, source.names(*named[:1])),
        lambda source: holds(getattr(source, table), *keys.required, *named),
    )
