"""Pictures of human and robot side by side: a strip of moments, a film, a GIF, a loop for the head of a page."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import UsageError, install_line
from robot_retarget.base.files import replacing
from robot_retarget.robot.model import Robot
from robot_retarget.tools.view.picture import Picture, Pixels, Unavailable, labelled, without_pillow
from robot_retarget.tools.view.render import MOVING, STILL, Finish, can_render, open_stage
from robot_retarget.tools.view.staging import Staging, arrange
from robot_retarget.trajectory import Trajectory

# Paint moments of a motion with MuJoCo and OpenGL, or draw figures where OpenGL is missing.


@contextmanager
def painter(
    staging: Staging, width: int, height: int, finish: Finish = STILL
) -> Iterator[tuple[Callable[[int], Pixels], str]]:
    """Return a function that paints the k-th moment of a staging, and a note if it is drawn without OpenGL."""
    stage = open_stage(staging, width, height, finish)
    if isinstance(stage, Unavailable):
        from robot_retarget.tools.view.draw import Sketch

        yield Sketch(staging, width, height).frame, f"{stage.reason}; figures are drawn instead"
        return
    try:
        yield stage.frame, ""
    finally:
        stage.close()


# An image strip: moments of a motion side by side.

STRIP_HEIGHT = 480
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
    height: int = STRIP_HEIGHT,
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
    if missing := without_pillow():
        return missing
    with painter(staging, round(height * staging.aspect), height) as (paint, note):
        moments = [labelled(paint(k), f"{time:.1f} s") for k, time in enumerate(staging.times)]
    gap = np.full((height, GAP, 3), 255, np.uint8)
    columns = [part for moment in moments for part in (moment, gap)][:-1]
    return Picture(np.concatenate(columns, axis=1), note)


# A short film of a motion that begins again when it ends: an animated WebP for the head of a page.

LOOP_HEIGHT = 240
"""Of the pictures [pixels]."""
LOOP_FPS = 10.0
"""Pictures a second [1/s]."""
MOST = 60
"""Number of pictures of a loop: two to three seconds of drawing. A longer motion is shown faster."""

LOOP_QUALITY = 35
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
    if missing := without_pillow():
        return missing
    from PIL import Image

    pace = max(trajectory.duration * LOOP_FPS / MOST, 1.0)
    times = np.arange(0, max(trajectory.duration, 1 / LOOP_FPS), pace / LOOP_FPS)[:MOST]
    staging = arrange(robot, trajectory, human, bones, times)
    with painter(staging, round(LOOP_HEIGHT * staging.aspect), LOOP_HEIGHT, finish=MOVING) as (paint, note):
        first, *others = [Image.fromarray(paint(k)) for k in range(len(times))]
    data = io.BytesIO()
    interval = round(1000 / LOOP_FPS)
    first.save(data, "WEBP", save_all=True, append_images=others, duration=interval, loop=0, quality=LOOP_QUALITY)
    return AnimatedWebP(data.getvalue(), pace, note)


# A film of human and robot side by side.

HEIGHT = 720
"""Of the film [pixels]."""
ASPECT = 4 / 3
"""Width over height of the film: 960 by 720. What needs more room to the sides has a wider one."""


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
    fps: float | None = None,
    height: int = HEIGHT,
    progress: Callable[[int, int], None] | None = None,
) -> Film | Unavailable:
    """Write an mp4 (H.264) of the whole trajectory at its own pace.

    Args:
        human: points and `bones` as for `strip`.
        fps: of the film [1/s]; by default 30, and 10 where figures are drawn for want of OpenGL, which takes longer.
        height: of the film [pixels].
        progress: called with (frames done, frames in all).

    Raises:
        UsageError: a rate that is not positive, or a human of another shape.
        TrajectoryError: it belongs to another robot.
        OutputError: it cannot be written.
    """
    if fps is None:
        fps = 30.0 if can_render() else 10.0
    if not (np.isfinite(fps) and fps > 0):
        raise UsageError(f"frames per second must be positive, got {fps}")
    times = np.arange(int(trajectory.duration * fps + 1e-9) + 1) / fps
    staging = arrange(robot, trajectory, human, bones, times)
    if missing := without_pillow():
        return missing
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return Unavailable(f"films need imageio-ffmpeg: {install_line('video')}")
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


# An animated GIF of human and robot side by side.

GIF_HEIGHT = 240
"""Of the pictures [pixels]."""
GIF_FPS = 12.5
"""Pictures a second [1/s]; a GIF knows whole hundredths of a second."""
COLOURS = 64


def gif(
    robot: Robot,
    trajectory: Trajectory,
    path: str | Path,
    human: Floats | None = None,
    bones: Ints | None = None,
    *,
    fps: float = GIF_FPS,
    height: int = GIF_HEIGHT,
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
    if missing := without_pillow():
        return missing
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
