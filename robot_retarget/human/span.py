"""Parts of a clip in words: frames or seconds."""

from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion


def part_of(motion: Motion, frames: str | None) -> Motion:
    """Return the part of a motion that `START:STOP` names; the whole for None.

    Raises:
        UsageError: the text is not of this form, or leaves the clip.
    """
    return motion if frames is None else motion.frames(*span_of(frames, len(motion), motion.fps))


def span_of(text: str, count: int, fps: float) -> tuple[int, int]:
    """The frames `START:STOP` of a clip; each end is a frame (`30`) or a time (`1.5s`), one frame alone is a span of one.

    Raises:
        UsageError: The text is not of this form.
    """

    def frame(end: str) -> int:
        return round(float(end[:-1]) * fps) if end.endswith("s") else int(end)

    start, colon, stop = (part.strip() for part in text.partition(":"))
    try:
        first = frame(start) if start else 0
        return first, frame(stop) if stop else count if colon else first + 1
    except (ValueError, OverflowError):
        raise UsageError(f"--frames takes START:STOP in frames (30:90) or seconds (1s:3s), got {text!r}") from None
