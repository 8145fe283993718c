"""A film of human and robot side by side."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import UsageError, install_line
from robot_retarget.base.files import replacing
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.painter import painter
from robot_retarget.tools.view.picture import NEEDS_PILLOW, Unavailable, has_pillow, labelled
from robot_retarget.tools.view.render import MOVING
from robot_retarget.tools.view.staging import Staging, arrange
from robot_retarget.trajectory import Trajectory

HEIGHT = 720
"""Of the film [pixels]."""
ASPECT = 4 / 3
"""Width over height of the film: 960 by 720. What needs more room to the sides has a wider one."""
NEEDS_FFMPEG = f"films need imageio-ffmpeg: {install_line('video')}"


@dataclass(frozen=True)
class Film:
    """A film that was written, with a note on how it was made."""

    path: Path
    frames: int
    note: str = ""


def video(
    robot: Robot,
    trajectory: Trajectory,
    path: str | Path,
    human: Floats | None = None,
    bones: Ints | None = None,
    *,
    fps: float = 30.0,
    height: int = HEIGHT,
    progress: Callable[[int, int], None] | None = None,
) -> Film | Unavailable:
    """Write an mp4 (H.264) of the whole trajectory at its own pace.

    Args:
        human: points and `bones` as for `strip`.
        fps: of the film [1/s].
        height: of the film [pixels].
        progress: called with (frames done, frames in all).

    Raises:
        UsageError: a rate that is not positive, or a human of another shape.
        TrajectoryError: it belongs to another robot.
        OutputError: it cannot be written.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise UsageError(f"frames per second must be positive, got {fps}")
    times = np.arange(int(trajectory.duration * fps + 1e-9) + 1) / fps
    staging = arrange(robot, trajectory, human, bones, times)
    if not has_pillow():
        return Unavailable(NEEDS_PILLOW)
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return Unavailable(NEEDS_FFMPEG)
    with replacing(path) as scratch:
        note = _film(staging, scratch, fps, height, progress)
    return Film(Path(path), len(times), note)


def _film(staging: Staging, path: Path, fps: float, height: int, progress: Callable[[int, int], None] | None) -> str:
    from imageio_ffmpeg import write_frames

    size = _even(height * max(staging.aspect, ASPECT)), _even(height)  # H.264 halves the colours' resolution
    rate: Any = fps  # annotated as int there, handed on to ffmpeg as text
    writer = write_frames(str(path), size, fps=rate, quality=7, macro_block_size=2, ffmpeg_log_level="error")
    writer.send(None)
    try:
        with painter(staging, *size, finish=MOVING) as (paint, note):
            for k, time in enumerate(staging.times):
                writer.send(np.ascontiguousarray(labelled(paint(k), f"{time:.1f} s")))
                if progress is not None:
                    progress(k + 1, len(staging.times))
    finally:
        writer.close()
    return note


def _even(pixels: float) -> int:
    return 2 * round(pixels / 2)
