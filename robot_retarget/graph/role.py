"""Roles, forms and stencils of edges: how the solver treats a kind, how it is measured, and which frames its edges join."""

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

    COST = "cost"
    """Minimised."""
    INEQUALITY = "inequality"
    """A row of the quadratic program."""
    BOUND = "bound"
    """A bound on a joint."""


class Form(Enum):
    """How a kind is measured."""

    SYMBOLIC = "symbolic"
    """By a CasADi expression of the robot's points, axes and joints, `Kind.measure`."""
    NUMERIC = "numeric"
    """By values and slopes: `Kind.rows` of a cost, `Kind.proximity` of an inequality."""
    JOINT = "joint"
    """By the joint coordinates of its ends, and their differences over the stencil."""
