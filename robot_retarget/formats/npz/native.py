"""Format `native`: this package's own trajectory file; see `robot_retarget.trajectory`."""

from pathlib import Path

from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.timing import require_same_robot
from robot_retarget.trajectory import KEYS, Trajectory, load_trajectory


def write(motion: RobotMotion, path: Path) -> None:
    """Write the file."""
    motion.trajectory.save(path)


def read(source: TrajectorySource) -> Trajectory:
    """Read the file, with times of the source and goals of the servos.

    Raises:
        TrajectoryError: it is broken, or another robot's.
    """
    trajectory = load_trajectory(source.path)
    require_same_robot(trajectory, source.robot)
    return trajectory


FORMAT = TrajectoryFormat(
    name="native",
    suffix=".npz",
    description="the trajectory file of every command here",
    write=write,
    read=read,
    claims=lambda source: set(KEYS) <= source.arrays.keys(),
    readers="robot-retarget",
    bodies=True,
)
