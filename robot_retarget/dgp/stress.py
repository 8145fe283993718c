"""The distance of a realization from its target distances: the three printed objectives and per-edge errors.

With d the measured distance of an edge, y the point of [lower, upper] nearest to d and e = d − y (for an exact
edge y = δ), the objectives are sums over the edges of

    RELATIVE          π |e| / max(y, floor)        [Mucherino2019, eq. 2]
    RELATIVE_SQUARED  π e² / max(y, floor)²        its smooth variant
    HALF_SQUARED      ½ π e²                       [MucherinoOmer2019, §1]
    SQUARED           π e²                         [Mucherino2017, eq. 2]

Edges with a Huber scale g count ϱ(e) = 2 g² (√(1 + (e/g)²) − 1) for e² in the last two. All four are unchanged by translation, rotation and reflection.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.arrays import Floats
from robot_retarget.dgp.graph import Graph
from robot_retarget.dgp.incidence import Incidence, incidence

FLOOR = 1e-3
"""Relative errors of a distance below this are relative to this value [m]: the target of a contact is δ = 0."""


class Objective(Enum):
    """The printed objectives; see the module for their equations."""

    RELATIVE = "relative"
    RELATIVE_SQUARED = "relative squared"
    HALF_SQUARED = "half squared"
    SQUARED = "squared"


@dataclass(frozen=True)
class Bounds:
    """[lower, upper], π and g of the edges, (E, B) for B realizations side by side."""

    lower: Floats
    upper: Floats
    priority: Floats
    huber_delta: Floats | None = None
    """None where every edge counts squares."""

    def nearest(self, distance: Floats) -> Floats:
        """y, the point of the interval nearest to the distance."""
        return np.clip(distance, self.lower, self.upper)


def edge_terms(
    objective: Objective, error: Floats, target: Floats, priority: Floats, huber_delta: Floats | None = None
) -> tuple[Floats, Floats, Floats]:
    """Each edge's share of σ and its first and second derivative by d, from e, y, π and g."""
    if objective in (Objective.HALF_SQUARED, Objective.SQUARED):
        weight = priority if objective is Objective.SQUARED else 0.5 * priority
        pull = weight * error
        if huber_delta is None:
            return pull * error, 2.0 * pull, 2.0 * weight
        root = np.sqrt(1.0 + (error / huber_delta) ** 2)
        return 2.0 * pull * error / (1.0 + root), 2.0 * pull / root, 2.0 * weight / root**3
    scale = np.maximum(target, FLOOR)
    if objective is Objective.RELATIVE_SQUARED:
        slope = priority * error / scale**2
        return slope * error, 2.0 * slope, 2.0 * priority / scale**2
    return priority * np.abs(error) / scale, priority * np.sign(error) / scale, np.zeros_like(error)


def value_and_gradient(inc: Incidence, bounds: Bounds, objective: Objective, x: Floats) -> tuple[Floats, Floats]:
    """σ (B,) and ∂σ/∂x (N, K, B) at x (N, K, B); a coincident pair pulls nowhere."""
    r, k = inc.differences(x)
    distance = lengths(r)
    target = bounds.nearest(distance)
    share, slope, _ = edge_terms(objective, distance - target, target, bounds.priority, bounds.huber_delta)
    slope /= np.where(distance > 0, distance, np.inf)
    r *= slope[:, None]
    return share.sum(0), inc.gather(r, k)


def lengths(r: Floats) -> Floats:
    """‖r‖ over axis 1 of (E, K, B)."""
    square = r[:, 0] * r[:, 0]
    for axis in range(1, r.shape[1]):
        square += r[:, axis] * r[:, axis]
    return np.sqrt(square, out=square)


def bounds_of(graph: Graph) -> Bounds:
    """The graph's intervals, priorities and Huber scales as one column."""
    huber_delta = None if np.isinf(graph.huber_delta).all() else graph.huber_delta[:, None]
    return Bounds(graph.lower[:, None], graph.upper[:, None], graph.priority[:, None], huber_delta)


def rows(x: Floats) -> Floats:
    """A realization (T, V, K) as the column (T·V, K, 1) the operators take."""
    return x.reshape(-1, x.shape[-1])[:, :, None]


def distances(graph: Graph, realization: ArrayLike) -> Floats:
    """d (E,) of every edge [m], Euclidean or interaction as its kind says.

    Raises:
        GraphError: the realization does not fit the graph.
    """
    r, _ = incidence(graph).differences(rows(graph.checked(realization)))
    return lengths(r)[:, 0]


def errors(graph: Graph, realization: ArrayLike) -> Floats:
    """e = d − y (E,) of every edge [m]: negative where the pair is too close."""
    d = distances(graph, realization)
    return d - np.clip(d, graph.lower, graph.upper)


def relative_errors(graph: Graph, realization: ArrayLike) -> Floats:
    """|e| / max(y, floor) (E,); its mean is the MDE, its greatest value the LDE."""
    d = distances(graph, realization)
    y = np.clip(d, graph.lower, graph.upper)
    return np.abs(d - y) / np.maximum(y, FLOOR)


def stress(graph: Graph, realization: ArrayLike, objective: Objective = Objective.SQUARED) -> float:
    """σ(x) of the chosen objective; `SQUARED` and `HALF_SQUARED` in [m²], the relative ones without unit.

    Raises:
        GraphError: the realization does not fit the graph.
    """
    x = rows(graph.checked(realization))
    return float(value_and_gradient(incidence(graph), bounds_of(graph), objective, x)[0][0])


def gradient(graph: Graph, realization: ArrayLike, objective: Objective = Objective.SQUARED) -> Floats:
    """∂σ/∂x (T, V, K): for HALF_SQUARED Σ_v π (1 − δ/‖x_u − x_v‖)(x_u − x_v) at u; a subgradient for RELATIVE."""
    checked = graph.checked(realization)
    _, slope = value_and_gradient(incidence(graph), bounds_of(graph), objective, rows(checked))
    return slope[:, :, 0].reshape(checked.shape)
