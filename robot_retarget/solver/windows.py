"""A clip of any length in windows of bounded memory that join without a seam.

Each window keeps the last frames of the window before unchanged. Those frames were solved with more foresight than the
range of the smooth path, so the frames after them fit as if both windows had been solved together.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from robot_retarget.base.arrays import Floats


@dataclass(frozen=True)
class Windows:
    """The lengths of the windows of a clip."""

    length: float = 20.0
    """Length of a window [s]; a clip that is little longer stays whole."""
    kept: float = 1.0
    """Part of the window before that is fixed at the start of the next [s]."""
    foreseen: float = 1.0
    """Part of a window that is solved only as foresight for the rest; the next window solves it again [s]."""

    def cut(self, frames: int, fps: float) -> Iterator["FrameWindow"]:
        """Yield windows that cover every frame once."""
        kept, foreseen = (max(1, round(seconds * fps)) for seconds in (self.kept, self.foreseen))
        length = max(round(self.length * fps), kept + foreseen + 1)  # every window adds a frame at least
        first, done = 0, 0
        while done < frames:
            last = first + length
            if last + kept + foreseen >= frames:
                last = frames
            final = last if last == frames else last - foreseen
            yield FrameWindow(first, last, done - first, final)
            first, done = final - kept, final


@dataclass(frozen=True)
class FrameWindow:
    """Frames `first` … `last` − 1; the first `fixed` are known, and those before `final` are kept."""

    first: int
    last: int
    fixed: int
    final: int

    def after(self, frame: int) -> "FrameWindow":
        """Return the same window in a piece that starts at a frame of the clip."""
        return replace(self, first=self.first - frame, last=self.last - frame, final=self.final - frame)


@dataclass(frozen=True, eq=False)
class ClipPiece:
    """Windows of a piece of a clip, with indices relative to its first frame."""

    windows: tuple[FrameWindow, ...]
    known: tuple[Floats, ...] = ()
    """(nq,) configurations of the first frames; the first window keeps them."""
