"""The definition of a format: a name, a writer, a reader, and a test whether a file is of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True)
class TrajectoryFormat:
    """One kind of file that holds the motion of a robot."""

    name: str
    suffix: str
    """The usual end of the file's name; empty for a folder."""
    description: str
    write: Callable[[RobotMotion, Path], None]
    """Writes the file or folder; raises UsageError when the robot does not suit the format."""
    read: Callable[[TrajectorySource], Columns | Trajectory]
    """Reads it; raises TrajectoryError when it is not as the format has it."""
    claims: Callable[[TrajectorySource], bool]
    """Whether a file looks as if it were of this format."""
    readers: str
    """Programs that read it."""
    fps: float | None = None
    """Rate that its readers take for granted [1/s]; None where the file says its own."""
    complete: bool = True
    """Whether the file itself states joint names, quaternion order and rate; if not, a JSON file next to it does."""
    ordered: bool = False
    """Whether the joints can be written in any order (`--joints`)."""
    exact: bool = True
    """Whether a written file reads back to 1e-9 m and rad."""
    plain: bool = False
    """Whether it holds a free root and hinges, and no other robots."""
    root: bool = True
    """Whether the file holds the pose of the root."""
    quaternion: str = "wxyz"
    """How the file orders the root's quaternion, or `euler`, `rotvec`, `none`."""
    bodies: bool = False
    """Whether the file itself holds the bodies around the robot; if not, an MJCF file next to it does."""
