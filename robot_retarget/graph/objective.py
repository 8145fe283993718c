"""The printed objectives: the share of one edge in the stress, and its derivatives by the distance.

With d the measured distance of an edge, y the point of [lower, upper] nearest to d and e = d − y (for an exact
edge y = δ), the objectives are sums over the edges of

    RELATIVE          π |e| / max(y, floor)        [Mucherino2019, eq. 2]
    RELATIVE_SQUARED  π e² / max(y, floor)²        its smooth variant
    HALF_SQUARED      ½ π e²                       [MucherinoOmer2019, §1]
    SQUARED           π e²                         [Mucherino2017, eq. 2]

Edges with a Huber scale g count ϱ(e) = 2 g² (√(1 + (e/g)²) − 1) for e² in the last two.
"""

from enum import Enum

import numpy as np

from robot_retarget.base.arrays import Floats

FLOOR = 1e-3
"""Relative errors of a distance below this are relative to this value [m]: the target of a contact is δ = 0."""


class Objective(Enum):
    """The printed objectives; see the module for their equations."""

    RELATIVE = "relative"
    RELATIVE_SQUARED = "relative squared"
    HALF_SQUARED = "half squared"
    SQUARED = "squared"


def edge_terms(
    objective: Objective, error: Floats, target: Floats, priority: Floats, huber_delta: Floats | None = None
) -> tuple[Floats, Floats, Floats]:
    """Return the share of every edge in σ and its first and second derivative by d.

    Args:
        objective: one of the four.
        error: e = d − y of any shape [m].
        target: y [m].
        priority: π.
        huber_delta: g [m], ∞ where an edge counts squares; None if every edge does.

    Returns:
        Three arrays of the shape of `error`.
    """
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
