"""A short film of a motion that begins again when it ends: an animated WebP for the head of a page."""

import io
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.painter import painter
from robot_retarget.tools.view.picture import NEEDS_PILLOW, Unavailable, has_pillow
from robot_retarget.tools.view.render import MOVING
from robot_retarget.tools.view.staging import arrange
from robot_retarget.trajectory import Trajectory

HEIGHT = 240
"""Of the pictures [pixels]."""
FPS = 10.0
"""Pictures a second [1/s]."""
MOST = 60
"""Number of pictures of a loop: two to three seconds of drawing. A longer motion is shown faster."""

QUALITY = 35
"""Of moving pictures as WebP, 0 … 100: 4 kB a picture."""


@dataclass(frozen=True)
class AnimatedWebP:
    """An animated WebP."""

    data: bytes
    pace: float
    """Duration of the motion over that of the loop [-]."""
    note: str = ""
    """On how it was made."""


def loop(
    robot: Robot, trajectory: Trajectory, human: Floats | None = None, bones: Ints | None = None
) -> AnimatedWebP | Unavailable:
    """Draw the whole motion in at most `MOST` small pictures.

    Args:
        human: points (T', J, 3) [m] and `bones` (B, 2) as for `strip`.

    Raises:
        UsageError: a human of another shape.
        TrajectoryError: it belongs to another robot.
    """
    if not has_pillow():
        return Unavailable(NEEDS_PILLOW)
    from PIL import Image

    pace = max(trajectory.duration * FPS / MOST, 1.0)
    times = np.arange(0, max(trajectory.duration, 1 / FPS), pace / FPS)[:MOST]
    staging = arrange(robot, trajectory, human, bones, times)
    with painter(staging, round(HEIGHT * staging.aspect), HEIGHT, finish=MOVING) as (paint, note):
        first, *others = [Image.fromarray(paint(k)) for k in range(len(times))]
    data = io.BytesIO()
    interval = round(1000 / FPS)
    first.save(data, "WEBP", save_all=True, append_images=others, duration=interval, loop=0, quality=QUALITY)
    return AnimatedWebP(data.getvalue(), pace, note)
