"""A file to be read: its contents, each part read once and on demand."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.errors import FileError
from robot_retarget.base.untrusted.arrays import load_npz, rate_of
from robot_retarget.base.untrusted.limits import LZ4_MAGIC, file_bytes, is_zip
from robot_retarget.base.untrusted.pickles import load_pickle
from robot_retarget.formats.options import FormatOptions
from robot_retarget.formats.sidecar import read_sidecar
from robot_retarget.robot.model import Robot

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
