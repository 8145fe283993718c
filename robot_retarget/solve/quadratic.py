"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from there."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.separation import Separation
from robot_retarget.solve.between import Between
from robot_retarget.solve.problem import Problem

SEPARATION_COST = 1e6
"""Per squared leg length of what cannot be kept apart at once: the program is never infeasible."""
COUPLED = 30.0
"""Weight of joints that are geared together and chains that close, over the squared leg length."""
GRACE = 2e-4
"""Links may stay where they lack so little of their margin, over the leg length: distances bend along a step, and one that
ends a hair inside the margin need not be refused."""
SUNK = -1e-4
"""A start this deep under the floor [m] takes its first steps whatever they cost."""
TAUGHT = 0.1
"""Curvature is learned from how the gradient changed along steps no longer than this [rad, m] ..."""
FALLEN = 1.5
"""... from where the cost was at most so many times as high: on its way to a foothold a foot bends it more than all else ..."""
LEARNED = 0.3
"""... unless it would be less than this share of the model's, or more than its inverse [-]."""


@dataclass(frozen=True)
class Pull:
    """Σ w (q ⊖ anchor − offset)²: draws a pose towards another, per tangent direction."""

    anchor: Floats
    offset: Floats
    weight: Floats


@dataclass(frozen=True)
class Ahead:
    """Σ w max(0, −k ḋ − room)²/ℓ²: interaction edges between links that near each other.

    Along the normal of their nearest surfaces the interaction distance of `dgp.interaction` is D = d + k ḋ, with ḋ = d − d
    a frame before, and its gradient (1 + k) times that of d. The edge counts where D would break the margin within k
    frames, by how much more than the `room` d − margin there is, so that links slow down before separation bites.
    """

    before: Floats
    """The configuration a frame before."""
    frames: float
    """k; real, so that the cost has no steps."""
    weight: float


@dataclass(frozen=True, eq=False)
class Quadratic:
    """cost + 2 gᵀv + vᵀNv for small steps v, with rows v ≥ least; the last variable is the slack of separation."""

    cost: float
    gradient: Floats
    """g (nv)."""
    normal: Floats
    """N (nv, nv)."""
    rows: Floats
    """(rows, nv + 1)."""
    least: Floats
    missing: float
    """How much more than `GRACE` the nearest links lack to be apart, over the leg length."""
    sunk: bool
    """Whether a sole is under the floor."""

    def after(self, step: Floats, before: "Quadratic") -> "Quadratic":
        """The model with the curvature that a step s (nv) from the model before has shown: N s = g − g_before (BFGS).

        N = Jᵀ W J leaves out how the Jacobian bends and takes ϱ for steeper than it is, so that a descent by it alone
        creeps along soft directions: each step three quarters of the one before.
        """
        if before.cost > FALLEN * self.cost or np.abs(step).max() > TAUGHT:
            return self
        expected, shown = self.normal @ step, self.gradient - before.gradient
        modelled, found = float(step @ expected), float(step @ shown)
        if not LEARNED * modelled < found < modelled / LEARNED:
            return self
        normal = self.normal - expected[:, None] * (expected / modelled)
        normal += shown[:, None] * (shown / found)
        return replace(self, normal=normal)

    def warned(self, soles: int, there: "Quadratic", step: Floats) -> "Quadratic":
        """The model with the rows of links that a step (nv) brought too near, as they are there: J v ≥ least + J step.

        Where the nearest places of two links change on the way, rows of the beginning alone lead into the same wall again.
        They stand in for those of the farthest links, and demand no more than to stay: here these links are apart.
        """
        hit = soles + np.flatnonzero(there.least[soles:] > 0)
        least, rows = self.least.copy(), self.rows.copy(order="F")
        farthest = soles + np.argsort(least[soles:], kind="stable")[: len(hit)]
        demand = np.minimum(there.least[hit] + there.rows[hit, :-1] @ step, max(least[soles:].max(), 0.0))
        rows[farthest], least[farthest] = there.rows[hit], demand
        return replace(self, rows=rows, least=least)

    def decrease(self, step: Floats, slack: float) -> float:
        """By how much the model says that a step (nv) lowers the cost, when links then lack `slack` over the leg."""
        posture = -float(step @ (2 * self.gradient + self.normal @ step))
        return posture + SEPARATION_COST * (self.missing**2 - slack**2)


class Landscape:
    """The cost of one frame's problem around any configuration."""

    def __init__(self, problem: Problem, separation: bool, margin: float, reach: float, glance: float = 0.0):
        """Keep links apart by a `margin`, those within a `reach` of each other, both over the leg length.

        Within a `glance` [rad, m] of a configuration distances go on along their slopes instead of being measured anew.
        """
        self.problem, self.robot, self.leg = problem, problem.robot, problem.match.robot_leg
        feet = frozenset(int(sole.bodies[0]) for sole in problem.match.anatomy.soles.values())
        floor = feet if self.robot.root_joints.size else None
        self.separation = (
            Separation(self.robot, reach * self.leg, margin * self.leg, feet=floor) if separation else None
        )
        self.glance, self._seen = glance, None
        self.coupling = Coupling(self.robot)
        self.rows = problem.soles + (self.separation.most if self.separation else 0)

    def around(self, q: Floats, wished: tuple[Floats, ...], between: tuple[Between, ...] = ()) -> Quadratic:
        """What the edges, gears, floor and links say at a configuration, and links `between` it and its neighbours."""
        cost, gradient, normal, floor, slope = self.problem.model(q, *wished)
        total = float(cost[0])
        if self.coupling.present:
            violation, tie = self.coupling(q)
            scale = COUPLED / self.leg**2
            total += scale * float(violation @ violation)
            gradient, normal = gradient + scale * (tie.T @ violation), normal + scale * (tie.T @ tie)
        nv, floors = len(gradient), len(floor)
        rows, least = np.zeros((self.rows, nv + 1), order="F"), np.full(self.rows, -np.inf)
        rows[:floors, :nv], least[:floors] = slope, -floor
        missing = 0.0
        if self.separation is not None:
            missing = self._apart(self._around(q, between), rows[floors:], least[floors:])
        total += SEPARATION_COST * missing**2
        return Quadratic(total, gradient, normal, rows, least, missing, bool(floor.min(initial=0.0) < SUNK))

    def _apart(self, links: tuple[Floats, Floats, Floats], rows: Floats, least: Floats) -> float:
        """Fill in the rows of near links; how much more than `GRACE` the nearest lack, over the leg length."""
        distance, slope, rest = links
        assert self.separation is not None
        wanted = self.separation.lacking(distance, rest)
        near, grace = len(distance), GRACE * self.leg
        rows[:near, :-1], rows[:near, -1] = slope, 1.0
        least[:near] = np.where(wanted > grace, wanted, np.minimum(wanted, 0.0))
        return max(float(wanted.max(initial=0.0)) - grace, 0.0) / self.leg

    def _around(self, q: Floats, between: tuple[Between, ...]) -> tuple[Floats, Floats, Floats]:
        """As `Separation.near`, with links between a configuration and its neighbours, which a share of a step moves.

        There they may touch: a margin would bend the frames more than the passage asks.
        """
        if not between:
            return self._near(q)
        assert self.separation is not None
        found = [self._near(q)]
        for way in between:
            distance, slope, rest = self.separation.near(way.at(self.robot, q))
            found.append((distance, way.share * slope, np.minimum(rest, 0.0)))
        distance, slope, rest = (np.concatenate(parts) for parts in zip(*found, strict=True))
        kept = self.separation.foremost(distance, rest)
        return distance[kept], slope[kept], rest[kept]

    def _near(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """As `Separation.near`; from a configuration hardly elsewhere, as its slopes tell."""
        assert self.separation is not None
        if self._seen is not None:
            there, (distance, slope, rest) = self._seen
            moved = difference(self.robot, there, q)
            if np.abs(moved).max() < self.glance:
                return distance + slope @ moved, slope, rest
        near = self.separation.near(q)
        if self.glance:
            self._seen = np.array(q), near
        return near

    def pulled(self, here: Quadratic, q: Floats, pull: Pull | None) -> Quadratic:
        """The model with a pull on top."""
        if pull is None:
            return here
        change = difference(self.robot, pull.anchor, q) - pull.offset
        return replace(
            here,
            cost=here.cost + float(pull.weight @ change**2),
            gradient=here.gradient + pull.weight * change,
            normal=here.normal + np.diag(pull.weight),
        )

    def foreseen(self, here: Quadratic, q: Floats, ahead: Ahead | None) -> Quadratic:
        """The model with interaction edges on top: on the rows of separation, whose `least` is what lacks to the margin."""
        if ahead is None or self.separation is None:
            return here
        rows, least = here.rows[self.problem.soles :, :-1], here.least[self.problem.soles :]
        coming = -ahead.frames * (rows @ difference(self.robot, ahead.before, q))
        broken = np.flatnonzero((coming > 0) & (coming + np.minimum(least, 0.0) > 0))
        if not broken.size:
            return here
        error = coming[broken] + np.minimum(least[broken], 0.0)
        slope = (ahead.frames + (least[broken] < 0))[:, None] * rows[broken]
        scale = ahead.weight / self.leg**2
        return replace(
            here,
            cost=here.cost + scale * float(error @ error),
            gradient=here.gradient - scale * (slope.T @ error),
            normal=here.normal + scale * (slope.T @ slope),
        )
