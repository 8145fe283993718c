"""Intervals and priorities of all edges of a graph side by side: every frame has its own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.track import Track, ordered


@dataclass(frozen=True, eq=False)
class EdgeTargets:
    """Targets of one frame, (E,) each, of all tracks in the order of `track.ordered`."""

    lower: Floats
    upper: Floats
    priority: Floats

    @property
    def clip(self) -> "ClipTargets":
        """The targets as those of a clip of one frame."""
        return ClipTargets(self.lower[None], self.upper[None], self.priority[None])


@dataclass(frozen=True, eq=False)
class ClipTargets:
    """Targets of T frames, (T, E) each, of all tracks in the order of `track.ordered`."""

    lower: Floats
    upper: Floats
    priority: Floats

    def __len__(self) -> int:
        return len(self.lower)

    def at(self, frame: int) -> EdgeTargets:
        """Of one frame."""
        return EdgeTargets(self.lower[frame], self.upper[frame], self.priority[frame])

    def frames(self, frames: Ints) -> "ClipTargets":
        """Of some frames (N,)."""
        return ClipTargets(self.lower[frames], self.upper[frames], self.priority[frames])

    def differ(self, other: "ClipTargets") -> Bools:
        """Return the frames (T,) at which an edge has another interval or priority."""
        sides = zip(vars(self).values(), vars(other).values(), strict=True)
        return np.any([(own != others).any(axis=1) for own, others in sides], axis=0)


def targets_of(tracks: Sequence[Track]) -> ClipTargets:
    """Return the intervals and priorities of a graph's tracks side by side."""
    sides = zip(*((*track.intervals, track.priority) for track in ordered(tracks)), strict=True)
    return ClipTargets(*(np.concatenate(side, axis=1) for side in sides))
