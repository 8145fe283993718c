"""An animated GIF of human and robot side by side."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import replacing
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.painter import painter
from robot_retarget.tools.view.picture import NEEDS_PILLOW, Unavailable, has_pillow
from robot_retarget.tools.view.staging import arrange
from robot_retarget.tools.view.video import Film
from robot_retarget.trajectory import Trajectory

HEIGHT = 240
"""Of the pictures [pixels]."""
FPS = 12.5
"""Pictures a second [1/s]; a GIF knows whole hundredths of a second."""
COLOURS = 64


def gif(
    robot: Robot,
    trajectory: Trajectory,
    path: str | Path,
    human: Floats | None = None,
    bones: Ints | None = None,
    *,
    fps: float = FPS,
    height: int = HEIGHT,
    progress: Callable[[int, int], None] | None = None,
) -> Film | Unavailable:
    """Write an animated GIF of the whole trajectory at its own pace, that begins again when it ends.

    Args:
        human: points and `bones` as for `strip`.
        fps: pictures a second, up to 50 [1/s].
        height: of the pictures [pixels].
        progress: called with (pictures done, pictures in all).

    Raises:
        UsageError: a rate out of range, or a human of another shape.
        TrajectoryError: it belongs to another robot.
        OutputError: it cannot be written.
    """
    if not 0 < fps <= 50:
        raise UsageError(f"a GIF has up to 50 pictures a second, got {fps:g}")
    if not has_pillow():
        return Unavailable(NEEDS_PILLOW)
    from PIL import Image

    times = np.arange(int(trajectory.duration * fps + 1e-9) + 1) / fps
    staging = arrange(robot, trajectory, human, bones, times)
    pictures = []
    with painter(staging, round(height * staging.aspect), height) as (paint, note):
        for k in range(len(times)):
            picture = Image.fromarray(paint(k))
            pictures.append(picture.quantize(COLOURS, dither=Image.Dither.NONE))
            if progress is not None:
                progress(k + 1, len(times))
    with replacing(path) as scratch:
        pace = round(100 / fps) * 10
        pictures[0].save(scratch, format="GIF", save_all=True, append_images=pictures[1:], duration=pace, loop=0)
    return Film(Path(path), len(times), note)
