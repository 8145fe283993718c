"""What numeric kinds return: values of edges and their slopes at a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot


@dataclass(frozen=True, eq=False)
class RowState:
    """Where a numeric kind is evaluated: at one configuration, or at N of them."""

    robot: Robot
    match: Match
    qpos: Floats
    """(nq,) the configuration, or (N, nq)."""
    reach: float
    """Surfaces farther apart need no rows [m]."""
    targets: tuple[Floats, ...] | None = None
    """Lower bounds, upper bounds and π (…, E) of the kind's edges, and its data (…, D); None in a repair, which reads overlaps."""
    memory: dict[str, Any] = field(default_factory=dict)
    """State of the kind between evaluations, per solver and track."""
    threads: int = 1
    """Number of threads among which the configurations may be shared."""

    def at(self, frame: int) -> "RowState":
        """Return one of the N."""
        sides = self.targets and tuple(side[frame] for side in self.targets)
        return replace(self, qpos=self.qpos[frame], targets=sides)


@dataclass(frozen=True, eq=False)
class MeasureRows:
    """Values of some edges and their Jacobian by the tangent vector."""

    values: Floats
    """(R,)."""
    slope: Floats
    """(R, nv)."""
    edges: Sequence[int] | np.ndarray
    """(R,) columns of the track; an edge may have several rows, or no row."""
    rest: Floats | float = np.inf
    """(R,) largest lower bound of a row of an inequality: surfaces that rest nearer than their margin may stay so."""


@dataclass(frozen=True, eq=False)
class ClipRows:
    """The rows of N configurations, those of one after those of another."""

    frame: Ints
    """(R,) the configuration of each row."""
    values: Floats
    """(R,)."""
    slope: Floats
    """(R, nv)."""
    edges: Ints
    """(R,) columns of the track."""
    rest: Floats
    """(R,) as that of `MeasureRows`."""

    def __len__(self) -> int:
        return len(self.values)

    @property
    def deficit(self) -> Floats:
        """(R,) largest lower bound minus value."""
        return self.rest - self.values

    def some(self, kept: Ints) -> "ClipRows":
        """Return some of the rows."""
        return ClipRows(*(column[kept] for column in vars(self).values()))

    @staticmethod
    def joined(parts: Sequence["ClipRows"]) -> "ClipRows":
        """Return the rows of several measurements of the same configurations."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return parts[0] if len(parts) == 1 else ClipRows(*map(np.concatenate, columns))

    @classmethod
    def of(cls, parts: Sequence[MeasureRows | None], nv: int) -> "ClipRows":
        """Return the rows (R, nv) of single configurations together."""
        found = [MeasureRows(np.zeros(0), np.zeros((0, nv)), np.zeros(0, int)) if one is None else one for one in parts]
        counts = [len(one.values) for one in found]
        columns = [(one.values, one.slope, np.asarray(one.edges), np.full(len(one.values), one.rest)) for one in found]
        return cls(np.repeat(np.arange(len(found)), counts), *map(np.concatenate, zip(*columns, strict=True)))
