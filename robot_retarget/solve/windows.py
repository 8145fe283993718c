"""A clip of any length in windows of bounded memory that join without a seam.

Each window takes over the last frames of the one before as they are: they had seen what comes after them, further than
the smooth path reaches, so that what follows them fits as if both had been solved together.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from robot_retarget.arrays import Floats


@dataclass(frozen=True)
class Windows:
    """How a clip is cut."""

    length: float = 20.0
    """Of a window [s]; a clip that is little longer stays whole."""
    kept: float = 1.0
    """How much of the window before stands fixed at the beginning of the next [s]."""
    foreseen: float = 1.0
    """How much of a window is only solved so that the rest foresees it, and then solved again by the next [s]."""

    def cut(self, frames: int, fps: float) -> Iterator["Window"]:
        """Windows that cover every frame once."""
        kept, foreseen = (max(1, round(seconds * fps)) for seconds in (self.kept, self.foreseen))
        length = max(round(self.length * fps), kept + foreseen + 1)  # every window adds a frame at least
        first, done = 0, 0
        while done < frames:
            last = first + length
            if last + kept + foreseen >= frames:
                last = frames
            final = last if last == frames else last - foreseen
            yield Window(first, last, done - first, final)
            first, done = final - kept, final


@dataclass(frozen=True)
class Window:
    """Frames `first` … `last` − 1, of which the first `fixed` are known and those up to `final` are kept."""

    first: int
    last: int
    fixed: int
    final: int

    def after(self, frame: int) -> "Window":
        """The same window in a piece that begins at a frame of the clip."""
        return replace(self, first=self.first - frame, last=self.last - frame, final=self.final - frame)


@dataclass(frozen=True, eq=False)
class Part:
    """Windows of a piece of a clip, counted from its first frame."""

    windows: tuple[Window, ...]
    known: tuple[Floats, ...] = ()
    """(nq,) configurations of the first frames, which the first window keeps."""
