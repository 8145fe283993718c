"""An image strip: moments of a motion side by side."""

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import UsageError
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.painter import painter
from robot_retarget.tools.view.picture import NEEDS_PILLOW, Picture, Unavailable, has_pillow, labelled
from robot_retarget.tools.view.staging import arrange
from robot_retarget.trajectory import Trajectory

HEIGHT = 480
"""Of the strip [pixels]."""
GAP = 4
"""White between two moments [pixels]."""


def strip(
    robot: Robot,
    trajectory: Trajectory,
    human: Floats | None = None,
    bones: Ints | None = None,
    *,
    count: int = 6,
    height: int = HEIGHT,
) -> Picture | Unavailable:
    """Evenly spaced moments from the first frame to the last, the human to the left of the robot at the same time.

    Args:
        human: points (T', J, 3) of the human [m], z up, over the same duration.
        bones: (B, 2) which points are joined.
        count: moments.
        height: of the picture [pixels].

    Raises:
        UsageError: no moments, or a human of another shape.
        TrajectoryError: it belongs to another robot.
    """
    if count < 1:
        raise UsageError(f"a strip needs at least one moment, got {count}")
    staging = arrange(robot, trajectory, human, bones, np.linspace(0, trajectory.duration, count))
    if not has_pillow():
        return Unavailable(NEEDS_PILLOW)
    with painter(staging, round(height * staging.aspect), height) as (paint, note):
        moments = [labelled(paint(k), f"{time:.1f} s") for k, time in enumerate(staging.times)]
    gap = np.full((height, GAP, 3), 255, np.uint8)
    columns = [part for moment in moments for part in (moment, gap)][:-1]
    return Picture(np.concatenate(columns, axis=1), note)
