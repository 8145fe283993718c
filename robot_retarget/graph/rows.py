"""What numeric kinds return: values of edges and their slopes at a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robot_retarget.arrays import Floats
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
