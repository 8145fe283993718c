"""Roles and stencils of edges: how the solver treats a kind, and which frames its edges join."""

from enum import Enum

FRAME = (0,)
"""One frame."""
STEP = (-1, 0)
"""A frame and the one before."""
SECOND_DIFFERENCE = (-1, 0, 1)
"""A frame and both neighbours."""
CAUSAL_DIFFERENCE = (-2, -1, 0)
"""A frame and the two before."""


class Role(Enum):
    """How the solver treats a kind of edge."""

    COST = "minimised"
    INEQUALITY = "a row of the quadratic program"
    BOUND = "a bound on a joint"
