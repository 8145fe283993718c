"""Options of a user about a file that lacks a statement."""

from dataclasses import dataclass
from pathlib import Path

SKIPPED = "_"
"""Stands in a list of joints for a column that no joint of the robot takes."""


@dataclass(frozen=True)
class FormatOptions:
    """Asked of an export or an import; everything has a default."""

    joints: tuple[str, ...] | None = None
    """Names of the joint columns in their order; `_` for a column that is not a joint of the robot."""
    fps: float | None = None
    """Frames per second of the output; by default those of the format, or of the file."""
    source_fps: float | None = None
    """Frames per second of a file that says none."""
    quaternion: str | None = None
    """`wxyz` or `xyzw`: the order in a file whose program wrote another than its format has."""
    servos: str | None = None
    """Servo map of formats that count servo ticks: a shipped robot's name or a TOML file."""
    scene: Path | None = None
    """Scene file with the bodies around the robot, for an import; by default the one next to the file."""
