"""Links near each other at the frames of a clip: their distances, and which of them have rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints

EQUAL = 1e-9
"""Rows whose distance and slope differ by less, in a fixed mixture, are one row [m]."""
TIE = 1e-6
"""Rows whose room differs by less are equal [m]: far above the rounding of distances."""


@dataclass(frozen=True, eq=False)
class LinearizedDistances:
    """Distances of links near each other, measured at N configurations."""

    frame: Ints
    """(C,) the configuration, 0 … N − 1."""
    distance: Floats
    """(C,) [m]."""
    slope: Floats
    """(C, nv) derivative by the tangent vector."""
    bound: Floats
    """(C,) least distance of the pairs [m]."""
    edges: Ints
    """(C,) their edges among those of all kinds."""

    @property
    def deficit(self) -> Floats:
        """(C,) bound minus distance [m]."""
        return self.bound - self.distance

    def largest_deficit(self, count: int) -> Floats:
        """Return the largest deficit of each of N configurations [m], −∞ without links near each other."""
        largest = np.full(count, -np.inf)
        np.maximum.at(largest, self.frame, self.deficit)
        return largest

    def __len__(self) -> int:
        return len(self.distance)

    def of(self, kept: Ints) -> "LinearizedDistances":
        """Return some of the pairs."""
        return LinearizedDistances(*(column[kept] for column in vars(self).values()))

    @staticmethod
    def none(nv: int) -> "LinearizedDistances":
        """Return no pairs."""
        whole, real = np.zeros(0, int), np.zeros(0)
        return LinearizedDistances(whole, real, np.zeros((0, nv)), real, whole)

    @staticmethod
    def joined(parts: Sequence["LinearizedDistances"]) -> "LinearizedDistances":
        """Return the pairs of several measurements of the same configurations."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return parts[0] if len(parts) == 1 else LinearizedDistances(*map(np.concatenate, columns))

    def foremost(self, most: int) -> "LinearizedDistances":
        """Return at most `most` rows of every configuration, in order of the configurations.

        Where they are more, each counts once, and the nearest come first.
        """
        counts = np.bincount(self.frame)
        if counts.max(initial=0) <= most and (self.frame[1:] >= self.frame[:-1]).all():
            return self
        found = self.of(np.lexsort((self.distance, self.frame)))
        crowded = np.flatnonzero((counts > most)[found.frame])
        kept = np.ones(len(found), dtype=bool)
        kept[crowded[_repeated(found.of(crowded))]] = False
        found = found.of(np.flatnonzero(kept))
        return found.of(np.flatnonzero(tightest_rows(found.frame, found.deficit, most)))


class NearLinks:
    """Distances of links near each other of N frames, each measured at a configuration; absent ones are infinite."""

    def __init__(self, qpos: Floats, most: int, nv: int):
        count = len(qpos)
        self.qpos = qpos.copy()
        """(N, nq)."""
        self.deficit = np.full((count, most), -np.inf)
        """(N, C) bound minus distance [m]."""
        self.slope = np.zeros((count, most, nv))
        """(N, C, nv) derivative of the distances by the tangent vector."""

    def of(self, frames: Ints) -> "NearLinks":
        """Return some of the frames."""
        found = NearLinks.__new__(NearLinks)
        found.qpos, found.deficit, found.slope = self.qpos[frames], self.deficit[frames], self.slope[frames]
        return found

    def replace(self, frames: Ints, other: "NearLinks", chosen: Bools) -> None:
        """Replace frames by the chosen ones of others."""
        for name in ("qpos", "deficit", "slope"):
            getattr(self, name)[frames] = getattr(other, name)[chosen]

    @classmethod
    def measured(cls, qpos: Floats, found: LinearizedDistances, most: int) -> "NearLinks":
        """Return the links found at configurations (N, nq), at most `most` of each."""
        near = cls(qpos, most, found.slope.shape[1])
        near._fill(found.foremost(most))
        return near

    def put(self, frames: Ints, qpos: Floats, found: LinearizedDistances) -> None:
        """Store the links found at configurations (F, nq) of frames (F,), at most C of each."""
        self.qpos[frames], self.deficit[frames], self.slope[frames] = qpos, -np.inf, 0.0
        found = found.foremost(self.deficit.shape[1])
        self._fill(replace(found, frame=frames[found.frame]))

    def _fill(self, found: LinearizedDistances) -> None:
        """Store links, which are in order, at frames without any."""
        place = found.frame, np.arange(len(found)) - np.searchsorted(found.frame, found.frame)
        self.deficit[place], self.slope[place] = found.deficit, found.slope


def _repeated(near: LinearizedDistances) -> Bools:
    """Return which rows equal an earlier one of their configuration: geoms that occur twice leave room for no fewer others."""
    mixed, same = near.slope @ np.cos(np.arange(near.slope.shape[1])) + near.distance, np.zeros(len(near), dtype=bool)
    order = np.lexsort((mixed, near.frame))
    same[order[1:]] = (near.frame[order[1:]] == near.frame[order[:-1]]) & (np.diff(mixed[order]) <= EQUAL)
    return same


def tightest_rows(frame: Ints, deficit: Floats, most: int) -> Bools:
    """Return which rows to keep, at most `most` of every configuration: those with the least room to their bound.

    Rows with equal room are kept or dropped together, so that left and right are treated alike. Where more than `most`
    rows have the least room, the first of them are kept.

    Args:
        frame: (C,) the configuration of each row, in order.
        deficit: (C,) bound minus distance [m].
        most: number of rows.
    """
    room, counts = -deficit, np.bincount(frame)
    order, first = np.lexsort((room, frame)), counts.cumsum() - counts
    rank = np.empty(len(order), dtype=int)
    rank[order] = np.arange(len(order)) - first[frame]
    least_dropped, crowded = np.full(len(counts), np.inf), counts > most
    least_dropped[crowded] = room[order[first[crowded] + most]]
    kept = room < least_dropped[frame] - TIE
    some = np.bincount(frame, weights=kept)[frame] > 0
    return np.where(some, kept, rank < most)
