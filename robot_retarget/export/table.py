"""The one table of export formats; a new format is a file beside this one and a line in `FORMATS`."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_retarget.errors import UsageError, known
from robot_retarget.export import csv_table, unitree
from robot_retarget.files import replacing
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True)
class Format:
    """One way to write a trajectory."""

    suffix: str
    """The usual end of the file's name."""
    write: Callable[[Trajectory, Robot, Path], None]
    """Writes the file; raises UsageError before it writes anything when the robot does not suit the format."""
    description: str


FORMATS: dict[str, Format] = {
    "csv": Format(".csv", csv_table.write, "time, root and joints with a header that names units; every robot"),
    "unitree": Format(
        ".csv", unitree.write, "Unitree LAFAN1 rows without a header: xyz, quaternion xyzw, joints; 30 fps"
    ),
}


def export(trajectory: Trajectory, robot: Robot, format: str, path: str | Path) -> Path:
    """Write a trajectory in one of the `FORMATS`, whole or not at all.

    Raises:
        UsageError: the format is not known, or the robot does not suit it.
        TrajectoryError: the trajectory belongs to another robot.
        OutputError: the file cannot be written.
    """
    if format not in FORMATS:
        raise UsageError(f"unknown format {format!r}; {known(FORMATS)}")
    require_same_robot(trajectory, robot)
    with replacing(path) as scratch:
        FORMATS[format].write(trajectory, robot, scratch)
    return Path(path)
