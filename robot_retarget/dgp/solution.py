"""The result of a solver: the realization, the reason that it stopped, and measures of its quality."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.dgp.graph import Graph
from robot_retarget.dgp.stress import Objective, errors, relative_errors, stress


class Status(Enum):
    """Why a solver stopped; the value is the message."""

    ZERO = "the stress fell below its tolerance"
    STATIONARY = "the step fell below its tolerance: a stationary point"
    STUCK = "no step along the search direction lowers the stress any further"
    LIMIT = "the iteration limit was reached: raise it, or start from this solution"
    INFEASIBLE = "the hard distances cannot all be met from this start"
    FAILED = "the back end gave up"

    @property
    def converged(self) -> bool:
        """Whether the solver stopped because it was done."""
        return self in (Status.ZERO, Status.STATIONARY)


@dataclass(frozen=True)
class Solution:
    """A realization of a graph with the story of how it was found."""

    graph: Graph
    positions: Floats
    """(T, V, K) [m]."""
    objective: Objective
    statuses: tuple[Status, ...]
    """One, or one per frame where the frames were solved apart."""
    iterations: tuple[int, ...]
    """As `statuses`."""
    history: tuple[float, ...]
    """σ after each iteration; the sum where the frames were solved apart."""
    seconds: float
    """Wall time [s]."""
    method: str

    @property
    def status(self) -> Status:
        """The worst of the statuses."""
        return max(self.statuses, key=list(Status).index)

    @cached_property
    def stress(self) -> float:
        """σ of the objective that was minimised."""
        return stress(self.graph, self.positions, self.objective)

    @cached_property
    def errors(self) -> Floats:
        """(E,) signed error of every edge [m]."""
        return errors(self.graph, self.positions)

    @cached_property
    def relative_errors(self) -> Floats:
        """(E,) relative error of every edge."""
        return relative_errors(self.graph, self.positions)

    @property
    def mean_error(self) -> float:
        """MDE, the mean relative error over the edges."""
        return float(self.relative_errors.mean()) if len(self.graph) else 0.0

    @property
    def largest_error(self) -> float:
        """LDE, the largest relative error over the edges."""
        return float(self.relative_errors.max(initial=0.0))

    def worst(self, count: int = 5) -> tuple[tuple[str, float], ...]:
        """The edges with the largest errors, by name, with the signed error [m]."""
        order = np.argsort(-np.abs(self.errors))[:count]
        return tuple((self.graph.edge_name(edge), float(self.errors[edge])) for edge in order)
