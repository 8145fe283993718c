"""What numeric kinds return: values of edges and their slopes at a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot


@dataclass(frozen=True, eq=False)
class Past:
    """The frame before."""

    qpos: Floats
    """(nq,)."""
    seconds: float
    """Time since the frame before [s]."""


@dataclass(frozen=True, eq=False)
class ContactRows:
    """Rows of the numeric inequalities near their bound at a configuration."""

    slope: Floats
    """(R, nv) slopes of the distances."""
    deficit: Floats
    """(R,) lower bound minus distance [m]."""


@dataclass(frozen=True, eq=False)
class RowState:
    """Where a numeric kind is evaluated."""

    robot: Robot
    match: Match
    qpos: Floats
    """(nq,) the configuration."""
    reach: float
    """Surfaces farther apart need no rows [m]."""
    past: Past | None = None
    """The frame before, for costs with the stencil (−1, 0); None at the first frame."""
    contacts: ContactRows | None = None
    """The rows of the numeric inequalities, for costs with the stencil (−1, 0); None without such kinds."""
    targets: tuple[Floats, Floats, Floats] | None = None
    """Lower bounds, upper bounds and π (E,) of the kind's edges at the frame; None where a repair asks for overlaps."""
    memory: dict[str, Any] = field(default_factory=dict)
    """State of the kind between evaluations, per solver and track."""


@dataclass(frozen=True, eq=False)
class RowStates:
    """Where a numeric inequality is evaluated: at N configurations."""

    robot: Robot
    match: Match
    qpos: Floats
    """(N, nq)."""
    reach: float
    """Surfaces farther apart need no rows [m]."""
    targets: tuple[Floats, Floats, Floats] | None
    """Lower bounds, upper bounds and π (N, E) of the kind's edges; None where a repair asks for overlaps."""
    memory: dict[str, Any]
    """State of the kind between evaluations, per solver and track."""
    threads: int = 1
    """Number of threads among which the configurations may be shared."""

    def at(self, frame: int) -> RowState:
        """Return one of them."""
        lower, upper, priority = self.targets or (self.qpos,) * 3
        sides = None if self.targets is None else (lower[frame], upper[frame], priority[frame])
        return RowState(self.robot, self.match, self.qpos[frame], self.reach, targets=sides, memory=self.memory)


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

    @classmethod
    def of(cls, parts: Sequence[MeasureRows | None], nv: int) -> "ClipRows":
        """Return the rows (R, nv) of single configurations together."""
        found = [MeasureRows(np.zeros(0), np.zeros((0, nv)), np.zeros(0, int)) if one is None else one for one in parts]
        counts = [len(one.values) for one in found]
        columns = [(one.values, one.slope, np.asarray(one.edges), np.full(len(one.values), one.rest)) for one in found]
        return cls(np.repeat(np.arange(len(found)), counts), *map(np.concatenate, zip(*columns, strict=True)))
