"""Links near each other at the frames of a clip: their distances, and which of them have rows."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.rows import ClipRows
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference

EQUAL = 1e-9
"""Rows whose distance and slope differ by less, in a fixed mixture, are one row [m]."""
TIE = 1e-6
"""Rows whose room differs by less are equal [m]: far above the rounding of distances."""


def foremost(found: ClipRows, most: int) -> ClipRows:
    """Return at most `most` rows of every configuration, in order of the configurations: the nearest. Equal ones count once."""
    found = found.some(np.lexsort((found.values, found.frame)))
    found = found.some(np.flatnonzero(~_repeated(found)))
    return found.some(np.flatnonzero(tightest_rows(found.frame, found.deficit, most)))


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
        self.before: NearLinks | None = None
        """The measurements that those of the frames replaced; None where they are not kept."""

    def __len__(self) -> int:
        return len(self.qpos)

    def of(self, frames: Ints) -> "NearLinks":
        """Return some of the frames."""
        found = NearLinks.__new__(NearLinks)
        found.qpos, found.deficit, found.slope = self.qpos[frames], self.deficit[frames], self.slope[frames]
        found.before = self.before and self.before.of(frames)
        return found

    def followed_by(self, other: "NearLinks") -> "NearLinks":
        """Return these frames and others after them, without what their measurements replaced."""
        found = NearLinks.__new__(NearLinks)
        found.before = None
        for name in ("qpos", "deficit", "slope"):
            setattr(found, name, np.concatenate([getattr(self, name), getattr(other, name)]))
        return found

    def replace(self, frames: Ints, other: "NearLinks", chosen: Bools | Ints) -> None:
        """Replace frames by the chosen ones of others."""
        for name in ("qpos", "deficit", "slope"):
            getattr(self, name)[frames] = getattr(other, name)[chosen]
        if self.before is not None and other.before is not None:
            self.before.replace(frames, other.before, chosen)

    @classmethod
    def measured(cls, qpos: Floats, found: ClipRows, most: int) -> "NearLinks":
        """Return the links found at configurations (N, nq), at most `most` of each."""
        near = cls(qpos, most, found.slope.shape[1])
        near._fill(foremost(found, most))
        return near

    def keep(self, measurements: int) -> None:
        """Keep a number of measurements that later ones replace."""
        if measurements:
            self.before = NearLinks(self.qpos, *self.slope.shape[1:])
            self.before.keep(measurements - 1)

    def measurements(self) -> Iterator["NearLinks"]:
        """Yield these measurements, and those that they replaced."""
        yield self
        yield from self.before.measurements() if self.before is not None else ()

    def put(self, frames: Ints, qpos: Floats, found: ClipRows) -> None:
        """Store the links found at configurations (F, nq) of frames (F,), at most C of each."""
        if self.before is not None:
            self.before.replace(frames, self.of(frames), np.arange(len(frames)))
        self.qpos[frames], self.deficit[frames], self.slope[frames] = qpos, -np.inf, 0.0
        found = foremost(found, self.deficit.shape[1])
        self._fill(replace(found, frame=frames[found.frame]))

    def extrapolated(self, robot: Robot, qpos: Floats) -> tuple[Floats, Floats]:
        """Return how far the fastest joints are from the measurements (N,) [rad or m], and deficits (N, C) along their slopes [m]."""
        moved = difference(robot, self.qpos, qpos)
        return np.abs(moved).max(axis=1), self.deficit - np.einsum("tcv,tv->tc", self.slope, moved)

    def _fill(self, found: ClipRows) -> None:
        """Store links, which are in order, at frames without any."""
        place = found.frame, np.arange(len(found)) - np.searchsorted(found.frame, found.frame)
        self.deficit[place], self.slope[place] = found.deficit, found.slope


def _repeated(near: ClipRows) -> Bools:
    """Return which rows equal an earlier one of their configuration: geoms that occur twice leave room for no fewer others."""
    mixed, same = near.slope @ np.cos(np.arange(near.slope.shape[1])) + near.values, np.zeros(len(near), dtype=bool)
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
