"""The result of a solver of points: the realization, the reason that it stopped, and measures of its quality."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.graph import EdgeError
from robot_retarget.graph.track import Objective, Status
from robot_retarget.papers.evaluation import distances, errors, relative_errors, stress
from robot_retarget.papers.points import PointGraph


@dataclass(frozen=True, eq=False)
class PointSolution:
    """A realization of a graph of points, and how it was found."""

    graph: PointGraph
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

    @property
    def converged(self) -> bool:
        """Whether every frame ended at a stationary point."""
        return self.status is Status.CONVERGED

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
        return float(self.relative_errors.mean()) if len(self.errors) else 0.0

    @property
    def largest_error(self) -> float:
        """LDE, the largest relative error over the edges."""
        return float(self.relative_errors.max(initial=0.0))

    def costliest(self, count: int = 8) -> list[EdgeError]:
        """Return the edges with the largest stress over all frames, each at its worst frame."""
        measured, first = {}, 0
        d = distances(self.graph, self.positions)
        for track in self.graph.tracks:
            present = track.present
            values = np.clip(np.zeros(present.shape), track.lower, track.upper)
            values[present] = d[first : first + int(present.sum())]
            measured[track.name], first = values, first + int(present.sum())
        return self.graph.costliest(measured, count)
