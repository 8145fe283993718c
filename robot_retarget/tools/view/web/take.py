"""A take: a robot's trajectory with its human, warnings, report and solution."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.collision import Warnings, warnings_of
from robot_retarget.human.match import Match, match
from robot_retarget.human.motion import Motion
from robot_retarget.judge.report import Report
from robot_retarget.robot.model import Robot
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.solver.solution import Solution
from robot_retarget.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Human:
    """The human's keypoints over the duration of a trajectory."""

    points: Floats
    """(T', K, 3), z up [m]."""
    bones: Ints
    """(B, 2) the keypoints at the ends of the bones."""
    names: tuple[str, ...]
    """K keypoints."""


@dataclass(frozen=True, eq=False)
class Take:
    """One robot in motion.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
    """

    robot: Robot
    trajectory: Trajectory
    human: Human | None = None
    """The motion of the trajectory's source."""
    warnings: Warnings | None = None
    """Warnings of the trajectory (`warnings_of`)."""
    report: Report | None = None
    """Report of the trajectory (`simulate`), or of the one before a touch-up."""
    solution: Solution | None = None
    """The solution of the trajectory, for the stress of its edges."""
    before: Trajectory | None = None
    """The trajectory before the latest touch-up or solution, frame by frame."""
    name: str = ""
    """Its name among other takes, such as that of a file; by default its source."""

    def __post_init__(self) -> None:
        require_same_robot(self.trajectory, self.robot)

    @property
    def title(self) -> str:
        """Name of the take and of its robot."""
        return f"{self.name or self.trajectory.source or 'a trajectory'} on {self.robot.name}"

    @property
    def stale(self) -> bool:
        """Whether the report is of another motion than the trajectory."""
        judged = self.report and self.report.trajectory
        return judged is not None and not np.array_equal(judged.qpos, self.trajectory.qpos)


def human_of(match: Match, motion: Motion) -> Human:
    """Return the human of a motion, with all its keypoints."""
    return Human(*match.figure(motion), match.recognition.keypoints)


def take_of(
    trajectory: Trajectory,
    robot: Robot,
    motion: Motion | None = None,
    *,
    overrides: str | Path | None = None,
    report: Report | None = None,
    name: str = "",
) -> Take:
    """Return a trajectory with its warnings, and with the human of a motion.

    Args:
        trajectory: the trajectory.
        robot: its robot.
        motion: the trajectory's source; the page shows it at the source times of the trajectory.
        overrides: a TOML file that replaces lines of the keypoint map (`human.match.match`).
        report: the report of the trajectory.
        name: name of the take among others.

    Raises:
        TrajectoryError: the trajectory belongs to another robot.
        MatchError: the motion is not human, or the robot no humanoid.
    """
    require_same_robot(trajectory, robot)
    human = None if motion is None else human_of(match(motion, robot, overrides), _in_step(motion, trajectory))
    warnings = warnings_of(trajectory, robot) if len(trajectory) > 1 else None
    return Take(robot, trajectory, human, warnings, report, name=name)


def file_names(paths: Sequence[Path]) -> list[str]:
    """Return different names for paths: file names, with as many folders as are necessary."""
    parts = [path.absolute().parts for path in paths]
    most = max(map(len, parts), default=1)
    found = (["/".join(own[-count:]) for own in parts] for count in range(1, most + 1))
    return next((names for names in found if len(set(names)) == len(set(parts))), [])


def _in_step(motion: Motion, trajectory: Trajectory) -> Motion:
    """Return the motion at the frames of the trajectory."""
    return motion.at_source_time(trajectory.source_time, trajectory.fps)
