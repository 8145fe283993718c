"""Pictures of human and robot side by side: a strip of moments, a film, a loop for the head of a page."""

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
from robot_retarget.tools.view.render import MOVING, SMALL, STILL, Finish, can_render, open_stage
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
STRIP_ROWS = 14
"""Rows of text that the height of a strip holds: six moments on a page of 390 pixels have letters of 7 pixels."""
STRIP_GAP = 4
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
        moments = [labelled(paint(k), f"{time:.1f} s", STRIP_ROWS) for k, time in enumerate(staging.times)]
    gap = np.full((height, STRIP_GAP, 3), 255, np.uint8)
    columns = [part for moment in moments for part in (moment, gap)][:-1]
    return Picture(np.concatenate(columns, axis=1), note)


# A short film of a motion that begins again when it ends: an animated WebP for the head of a page.

LOOP_HEIGHT = 240
"""Of the pictures [pixels]."""
LOOP_FPS = 10.0
"""Pictures a second [1/s]."""
MOST_PICTURES = 60
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
    """Draw the whole motion in at most `MOST_PICTURES` small pictures.

    Args:
        human: points (T', J, 3) [m] and `bones` (B, 2) as for `strip`.

    Raises:
        UsageError: a human of another shape.
        TrajectoryError: it belongs to another robot.
    """
    if missing := without_pillow():
        return missing
    from PIL import Image

    pace = max(trajectory.duration * LOOP_FPS / MOST_PICTURES, 1.0)
    times = np.arange(0, max(trajectory.duration, 1 / LOOP_FPS), pace / LOOP_FPS)[:MOST_PICTURES]
    staging = arrange(robot, trajectory, human, bones, times)
    with painter(staging, round(LOOP_HEIGHT * staging.aspect), LOOP_HEIGHT, finish=SMALL) as (paint, note):
        first, *others = [Image.fromarray(paint(k)) for k in range(len(times))]
    data = io.BytesIO()
    interval = round(1000 / LOOP_FPS)
    first.save(data, "WEBP", save_all=True, append_images=others, duration=interval, loop=0, quality=LOOP_QUALITY)
    return AnimatedWebP(data.getvalue(), pace, note)


# A film of human and robot side by side.

HEIGHT = {".mp4": 720, ".gif": 240}
"""Of the film by the suffix of its file [pixels]."""
ASPECT = 4 / 3
"""Width over height of an mp4: 960 by 720. What needs more room to the sides has a wider one."""
GIF_FPS = 12.5
"""Pictures a second of a GIF [1/s], which knows whole hundredths of a second."""
COLOURS = 64
"""Of a GIF."""


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
    height: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Film | Unavailable:
    """Write a film of the whole trajectory at its own pace: an mp4 (H.264), or an animated GIF that begins again when it ends.

    Args:
        human: points and `bones` as for `strip`.
        fps: of the film [1/s]; by default 30 (12.5 of a GIF), and 10 where figures are drawn for want of OpenGL, which takes longer.
        height: of the film [pixels]; by default 720 (240 of a GIF).
        progress: called with (frames done, frames in all).

    Raises:
        UsageError: a rate or suffix that no film has, or a human of another shape.
        TrajectoryError: it belongs to another robot.
        OutputError: it cannot be written.
    """
    kind = Path(path).suffix.lower()
    if kind not in HEIGHT:
        raise UsageError(f"{path}: a film is .mp4 or .gif")
    if fps is None:
        fps = (GIF_FPS if kind == ".gif" else 30.0) if can_render() else 10.0
    if not 0 < fps <= (50 if kind == ".gif" else 1000):
        raise UsageError(f"frames per second must be positive, and 50 at most in a GIF, got {fps}")
    times = np.arange(int(trajectory.duration * fps + 1e-9) + 1) / fps
    staging = arrange(robot, trajectory, human, bones, times)
    if missing := without_pillow() or (without_ffmpeg() if kind == ".mp4" else None):
        return missing
    height = height or HEIGHT[kind]
    aspect = max(staging.aspect, ASPECT) if kind == ".mp4" else staging.aspect
    size = _even(height * aspect), _even(height)  # H.264 halves the colours' resolution
    with replacing(path) as scratch, painter(staging, *size, finish=MOVING) as (paint, note):
        (_write_gif if kind == ".gif" else _write_mp4)(scratch, _frames(paint, times, progress), size, fps)
    return Film(Path(path), len(times), note)


def _frames(
    paint: Callable[[int], Pixels], times: Floats, progress: Callable[[int, int], None] | None
) -> Iterator[Pixels]:
    for k, time in enumerate(times):
        yield labelled(paint(k), f"{time:.1f} s")
        if progress is not None:
            progress(k + 1, len(times))


def _write_mp4(path: Path, frames: Iterator[Pixels], size: tuple[int, int], fps: float) -> None:
    from imageio_ffmpeg import write_frames

    rate: Any = fps  # annotated as int there, handed on to ffmpeg as text
    writer = write_frames(str(path), size, fps=rate, quality=7, macro_block_size=2, ffmpeg_log_level="error")
    writer.send(None)
    try:
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


def _write_gif(path: Path, frames: Iterator[Pixels], size: tuple[int, int], fps: float) -> None:
    from PIL import Image

    first, *others = [Image.fromarray(frame).quantize(COLOURS, dither=Image.Dither.NONE) for frame in frames]
    first.save(path, "GIF", save_all=True, append_images=others, duration=round(100 / fps) * 10, loop=0)


def without_ffmpeg() -> Unavailable | None:
    """Return why films cannot be written, if they cannot."""
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return Unavailable(f"films need imageio-ffmpeg: {install_line('video')}")
    return None


def _even(pixels: float) -> int:
    return 2 * round(pixels / 2)
