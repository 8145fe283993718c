"""A trajectory with its robot, in the forms that the public functions accept."""

from pathlib import Path
from typing import Protocol

from robot_retarget.robot.catalog import as_robot
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import Trajectory, load_trajectory


class Retargeted(Protocol):
    """A result of `retarget`."""

    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def robot(self) -> Robot: ...


Played = Retargeted | Trajectory | str | Path
"""A result, a trajectory, or the path of its file."""


def on_robot(played: Played, robot: Robot | str | Path | None = None) -> tuple[Trajectory, Robot]:
    """Return a trajectory and its robot; by default the robot of the result, or the one that the trajectory names.

    Raises:
        TrajectoryError: the file cannot be read, or is of another robot.
        RobotError: no robot has the name, or its file does not load.
    """
    given = load_trajectory(played) if isinstance(played, str | Path) else played
    trajectory = given if isinstance(given, Trajectory) else given.trajectory
    found = as_robot(given.robot if robot is None else robot)
    require_same_robot(trajectory, found)
    return trajectory, found
