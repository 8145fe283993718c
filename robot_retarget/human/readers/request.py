"""Options of a caller for the reading of a motion file."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from robot_retarget.base.errors import MotionError, known

USUAL_FPS = 30.0
"""Default for files without a frame rate, of formats without a usual one [1/s]."""
RATES = (0.01, 10_000.0)
"""Frame rates outside these bounds are mistakes [1/s]."""


@dataclass(frozen=True)
class Request:
    """Options of a caller; each reader uses those of its format."""

    fps: float | None = None
    """Frames per second, in place of those in the file [1/s]."""
    names: Sequence[str] | None = None
    """Joint names, for arrays that carry none."""
    clip: str | None = None
    """Which of several motions in the file."""
    body_model: Path | None = None
    """The body model of SMPL parameters."""
    listed: list[str] = field(default_factory=list, compare=False)
    """Names of the motions or people of the file; empty for a single one."""

    def rate(self, stored: float | None = None, usual: float = USUAL_FPS) -> tuple[float, tuple[str, ...]]:
        """Return frames per second: the caller's, else the stored, else the usual ones, with a note unless they are stored.

        Raises:
            MotionError: the rate is out of `RATES`.
        """
        for rate in (self.fps, stored if self.fps is None else None):
            if rate is not None and not RATES[0] <= rate <= RATES[1]:
                raise MotionError(f"frames per second must be from {RATES[0]:g} to {RATES[1]:g}, got {rate:g}")
        if self.fps is not None:
            differs = stored is not None and stored != self.fps
            note = f"Read at {self.fps:g} frames per second; the file says {stored:.4g}." if differs else ""
            return self.fps, (note,) if note else ()
        if stored is None:
            return usual, (f"The file says no frame rate; {usual:g} frames per second were taken.",)
        return stored, ()

    def choose(self, clips: Sequence[str], path: str | Path) -> tuple[int, tuple[str, ...]]:
        """Return the index of the requested clip, or of the first with a note about the others.

        Raises:
            MotionError: no clip has that name; lists those there are.
        """
        if len(clips) > 1 and not self.listed:
            self.listed.extend(clips)
        if self.clip is not None:
            called = [k for k, name in enumerate(clips) if name.lower() == self.clip.lower()]
            if not called:
                raise MotionError(f"holds no motion {self.clip!r}; {known(clips, 100)}", path)
            return called[0], ()
        if len(clips) < 2:
            return 0, ()
        listed = ", ".join(clips[:8]) + (", …" if len(clips) > 8 else "")
        ask = f"{Path(path).name}#{clips[1]}"
        return 0, (f"The first of {len(clips)} motions was read ({listed}); ask for another as {ask!r}.",)
