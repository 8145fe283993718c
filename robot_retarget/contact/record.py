"""The record of a path's contacts: which feet of a human or a robot are on the ground. Every reader of feet asks it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Bools, Ints, intervals
from robot_retarget.base.keypoints import SIDES


@dataclass(frozen=True, eq=False)
class ContactRecord:
    """Contacts of F feet over T frames; a part of them by index, `record[frames]`."""

    feet: tuple[str, ...]
    """F of `l` and `r`."""
    down: Bools
    """(T, F) whether a foot is on the ground, at any speed."""
    stands: Bools
    """(T, F, 2) whether its toe stands, and whether its heel does: on the ground and slow."""
    floor: float = 0.0
    """Height of the ground under the path of a robot [m]; 0 among bodies."""

    def __len__(self) -> int:
        return len(self.down)

    def __getitem__(self, frames: slice | Bools | Ints) -> "ContactRecord":
        return replace(self, down=self.down[frames], stands=self.stands[frames])

    def of(self, foot: str) -> Bools:
        """Return (T, 2) whether toe and heel of a foot stand; never for a foot that is not known."""
        known = foot in self.feet
        return self.stands[:, self.feet.index(foot)] if known else np.zeros((len(self), 2), dtype=bool)

    @property
    def planted(self) -> Bools:
        """(T, F) whether a part of each foot stands."""
        return np.asarray(self.stands.any(axis=2))

    @property
    def flying(self) -> Bools:
        """(T,) whether no foot is on the ground; never for a body without feet."""
        return ~np.asarray(self.down.any(axis=1)) if self.feet else np.zeros(len(self), dtype=bool)

    @property
    def labels(self) -> Bools:
        """(T, 2 F) whether the heel of each foot stands, and whether its toe does, as sources of motions give contacts."""
        return self.stands[:, :, ::-1].reshape(len(self), -1)

    @property
    def swings(self) -> list[tuple[str, int, int]]:
        """Of each swing inside the path the foot, the frame of its lift-off and that of its touchdown."""
        spans = [(foot, *span) for foot, down in zip(self.feet, self.down.T, strict=True) for span in intervals(~down)]
        return [(foot, start, stop) for foot, start, stop in spans if start > 0 and stop < len(self)]


def joined_records(records: Sequence[ContactRecord]) -> ContactRecord:
    """Return the record of consecutive parts of a path."""
    down, stands = (np.concatenate([getattr(each, name) for each in records]) for name in ("down", "stands"))
    return replace(records[0], down=down, stands=stands)


def labelled(labels: Bools) -> ContactRecord:
    """Return the record of labels (T, 4): whether left heel, left toe, right heel and right toe stand."""
    return standing_on(SIDES, np.asarray(labels, dtype=bool).reshape(-1, len(SIDES), 2)[:, :, ::-1])


def standing_on(feet: tuple[str, ...], stands: Bools) -> ContactRecord:
    """Return the record of feet whose toe and heel stand as (T, F, 2) says, and that are down where a part of them stands."""
    return ContactRecord(feet, np.asarray(stands.any(axis=2)), stands)
