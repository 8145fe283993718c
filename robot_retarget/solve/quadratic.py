"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from there."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.separation import Separation
from robot_retarget.solve.between import Between
from robot_retarget.solve.options import Options
from robot_retarget.solve.problem import Problem, Wish


@dataclass(frozen=True)
class Proximal:
    """Σ w (q ⊖ anchor − offset)²: draws a pose towards another, per tangent direction."""

    anchor: Floats
    offset: Floats
    weight: Floats


@dataclass(frozen=True)
class Interaction:
    """Σ π max(0, margin − D)²/ℓ²: interaction edges between links that near each other, δ = [margin, ∞).

    D is the interaction distance of `dgp.interaction` with its minimum over α = 1 + k, of surfaces that are taken as flat
    where they are nearest: their signed distance d changes by ḋ with every step, and so

        D = min_{0 ≤ k ≤ H} d + k ḋ,    k = H where links near each other, k = 0 where they part,

    with (1 + k) times the gradient of d. What d itself lacks to the margin is left to separation.
    """

    before: Floats
    """The configuration a frame before."""
    horizon: float
    """H in frames; real, so that the cost has no steps."""
    weight: float
    """π."""


@dataclass(frozen=True, eq=False)
class Near:
    """Links near each other, as measured at a configuration."""

    qpos: Floats
    distance: Floats
    """(C,) [m]."""
    slope: Floats
    """(C, nv) by the tangent vector."""
    rest: Floats
    """(C,) how far apart the pairs rest [m]."""


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
    """How much more than the tolerance the nearest links lack to their margin, over the leg."""
    sunk: bool
    """Whether a sole is under the floor."""
    near: Near | None = None
    """The links near each other, where they were last measured."""

    def with_rows_met(self, soles: int, there: "Quadratic", step: Floats) -> "Quadratic":
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


class CostModel:
    """The cost of one frame's problem around any configuration, links kept apart."""

    def __init__(self, problem: Problem, options: Options):
        self.problem, self.robot, self.leg, self.options = problem, problem.robot, problem.leg, options
        feet = frozenset(int(sole.bodies[0]) for sole in problem.match.anatomy.soles.values())
        floor = feet if self.robot.root_joints.size else None
        reach, margin = options.reach * self.leg, options.margin * self.leg
        self.separation = Separation(self.robot, reach, margin, feet=floor) if options.separation else None
        self.coupling = Coupling(self.robot)
        self.rows = problem.soles + (self.separation.most if self.separation else 0)

    def linearize(
        self, q: Floats, wish: Wish, between: tuple[Between, ...] = (), known: Near | None = None
    ) -> Quadratic:
        """What edges, gears, floor and links say at a configuration, and links `between` it and its neighbours.

        Args:
            known: links as they were measured nearby: less than a `glance` away they go on along their slopes.
        """
        total, gradient, normal = self.problem.model(q, wish)
        floor, slope = self.problem.heights(q)
        if self.coupling.present:
            violation, tie = self.coupling(q)
            scale = self.options.coupled / self.leg**2
            total += scale * float(violation @ violation)
            gradient, normal = gradient + scale * (tie.T @ violation), normal + scale * (tie.T @ tie)
        nv, floors = len(gradient), len(floor)
        rows, least = np.zeros((self.rows, nv + 1), order="F"), np.full(self.rows, -np.inf)
        rows[:floors, :nv], least[:floors] = slope, -floor
        near = self._near(q, known)
        missing = self._apart(q, near, between, rows[floors:], least[floors:]) if near else 0.0
        total += self.options.overlap_cost * missing**2
        sunk = bool(floor.min(initial=0.0) < -self.options.sunk)
        return Quadratic(total, gradient, normal, rows, least, missing, sunk, near)

    def cost(self, q: Floats, wish: Wish) -> float:
        """What is minimised, at a configuration."""
        return self.problem.cost(q, wish) + self.coupling_cost(q) + self.separation_cost(q)

    def coupling_cost(self, q: Floats) -> float:
        """Its part for gears that are out of mesh and chains that are open."""
        if not self.coupling.present:
            return 0.0
        violation = self.coupling(q)[0]
        return self.options.coupled / self.leg**2 * float(violation @ violation)

    def separation_cost(self, q: Floats) -> float:
        """Its part for links that lack more to their margin than is tolerated."""
        if self.separation is None:
            return 0.0
        distance, _, rest = self.separation.near(q)
        return self.options.overlap_cost * self._missing(self.separation.lacking(distance, rest)) ** 2

    def _missing(self, wanted: Floats) -> float:
        """How much more than what is tolerated the nearest links lack, over the leg."""
        return max(float(wanted.max(initial=0.0)) - self.options.tolerated * self.leg, 0.0) / self.leg

    def interaction_cost(self, q: Floats, interaction: Interaction) -> float:
        """The part of interaction edges, at a configuration."""
        near = self._near(q, None)
        if near is None:
            return 0.0
        rows, least = np.zeros((self.rows, near.slope.shape[1] + 1)), np.full(self.rows, -np.inf)
        self._apart(q, near, (), rows, least)
        error = self._foreseen(rows[:, :-1], least, q, interaction)
        return interaction.weight / self.leg**2 * float(error @ error)

    def _foreseen(self, rows: Floats, least: Floats, q: Floats, interaction: Interaction) -> Floats:
        """How much D lacks to the margin beyond what d does itself [m], per row of separation."""
        step = difference(self.robot, interaction.before, q)
        ahead = interaction.horizon * np.minimum(rows @ step, 0.0)  # k = H or 0, whichever makes d + k ḋ least
        return np.where(ahead < 0, np.maximum(-ahead + np.minimum(least, 0.0), 0.0), 0.0)

    def decrease(self, here: Quadratic, step: Floats, slack: float) -> float:
        """By how much the model says that a step (nv) lowers the cost, when links then lack `slack` over the leg."""
        edges = -float(step @ (2 * here.gradient + here.normal @ step))
        return edges + self.options.overlap_cost * (here.missing**2 - slack**2)

    def _near(self, q: Floats, known: Near | None) -> Near | None:
        """The links near each other: measured, or as known nearby."""
        if self.separation is None:
            return None
        if known is not None and np.abs(difference(self.robot, known.qpos, q)).max() < self.options.glance:
            return known
        return Near(np.array(q), *self.separation.near(q))

    def _apart(self, q: Floats, near: Near, between: tuple[Between, ...], rows: Floats, least: Floats) -> float:
        """Fill in the rows of near links; how much more than the tolerance the nearest lack, over the leg."""
        distance, slope, rest = self._with_ways(q, near, between)
        assert self.separation is not None
        wanted = self.separation.lacking(distance, rest)
        count, tolerance = len(distance), self.options.tolerated * self.leg
        rows[:count, :-1], rows[:count, -1] = slope, 1.0
        least[:count] = np.where(wanted > tolerance, wanted, np.minimum(wanted, 0.0))
        return self._missing(wanted)

    def _with_ways(self, q: Floats, near: Near, between: tuple[Between, ...]) -> tuple[Floats, Floats, Floats]:
        """Distances, slopes and rests at a configuration, and between it and its neighbours, which a share of a step moves.

        There links may touch: a margin would bend the frames more than the passage asks.
        """
        assert self.separation is not None
        here = near.distance
        if near.qpos is not q:
            here = here + near.slope @ difference(self.robot, near.qpos, q)
        if not between:
            return here, near.slope, near.rest
        found = [(here, near.slope, near.rest)]
        for way in between:
            distance, slope, rest = self.separation.near(way.at(self.robot, q))
            found.append((distance, way.share * slope, np.minimum(rest, 0.0)))
        distance, slope, rest = (np.concatenate(parts) for parts in zip(*found, strict=True))
        kept = self.separation.foremost(distance, rest)
        return distance[kept], slope[kept], rest[kept]

    def with_proximal(self, here: Quadratic, q: Floats, proximal: Proximal | None) -> Quadratic:
        """The model with a proximal term on top."""
        if proximal is None:
            return here
        change = difference(self.robot, proximal.anchor, q) - proximal.offset
        return replace(
            here,
            cost=here.cost + float(proximal.weight @ change**2),
            gradient=here.gradient + proximal.weight * change,
            normal=here.normal + np.diag(proximal.weight),
        )

    def with_interaction(self, here: Quadratic, q: Floats, interaction: Interaction | None) -> Quadratic:
        """The model with interaction edges on top, on the rows of separation, whose `least` is what lacks to the margin."""
        if interaction is None or self.separation is None:
            return here
        rows, least = here.rows[self.problem.soles :, :-1], here.least[self.problem.soles :]
        error = self._foreseen(rows, least, q, interaction)
        short = np.flatnonzero(error)
        if not short.size:
            return here
        error, alpha = error[short], interaction.horizon + (least[short] < 0)
        slope = alpha[:, None] * rows[short]
        scale = interaction.weight / self.leg**2
        return replace(
            here,
            cost=here.cost + scale * float(error @ error),
            gradient=here.gradient - scale * (slope.T @ error),
            normal=here.normal + scale * (slope.T @ slope),
        )
