"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from it."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.kinds.kind import ContactRows, Evaluator, Nearby, Numeric, Past, Projecting, Proximity
from robot_retarget.graph.role import FRAME, STEP, Role
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference
from robot_retarget.solve.options import SolveOptions
from robot_retarget.solve.problem import EdgeTargets, Problem
from robot_retarget.solve.swept_collision import SweptConfiguration


@dataclass(frozen=True)
class Proximal:
    """Σ w (q ⊖ anchor − offset)²: draws a pose towards another, per tangent direction."""

    anchor: Floats
    offset: Floats
    weight: Floats


@dataclass(frozen=True, eq=False)
class LinearizedDistances:
    """Distances of links near each other, measured at a configuration."""

    qpos: Floats
    distance: Floats
    """(C,) [m]."""
    slope: Floats
    """(C, nv) derivative by the tangent vector."""
    rest: Floats
    """(C,) rest distance of the pairs [m]."""


@dataclass(frozen=True, eq=False)
class Quadratic:
    """cost + 2 gᵀv + vᵀNv for small steps v, with rows v ≥ row_lower; the last variable is the slack of separation."""

    cost: float
    gradient: Floats
    """g (nv)."""
    normal: Floats
    """N (nv, nv)."""
    rows: Floats
    """(rows, nv + 1)."""
    row_lower: Floats
    clearance_deficit: float
    """How much more than the tolerance the nearest links lack to their margin, over the leg."""
    penetrates_floor: bool
    """Whether a sole is under the floor."""
    near: LinearizedDistances | None = None
    """The links near each other, at their last measurement."""

    def with_rows_met(self, soles: int, trial: "Quadratic", step: Floats) -> "Quadratic":
        """Return the model with the rows of links that a step (nv) brought too near, measured after it: J v ≥ row_lower + J step.

        The nearest places of two links may change along a step, and then rows of its start allow the same step again. The
        new rows replace those of the farthest links. They demand no more than the present distance.
        """
        hit = soles + np.flatnonzero(trial.row_lower[soles:] > 0)
        row_lower, rows = self.row_lower.copy(), self.rows.copy(order="F")
        farthest = soles + np.argsort(row_lower[soles:], kind="stable")[: len(hit)]
        demand = np.minimum(trial.row_lower[hit] + trial.rows[hit, :-1] @ step, max(row_lower[soles:].max(), 0.0))
        rows[farthest], row_lower[farthest] = trial.rows[hit], demand
        return replace(self, rows=rows, row_lower=row_lower)


class NumericCost:
    """The cost of a track with a numeric evaluator."""

    name: str
    stencil: tuple[int, ...]
    track: Track
    evaluate: Evaluator

    def __init__(self, track: Track, robot: Robot):
        self.name, self.stencil, self.track = track.name, track.stencil, track
        self.evaluate = cast(Numeric, track.kind).evaluator(track, robot)

    def terms(self, q: Floats, past: Past | None, contacts: ContactRows | None) -> tuple[float, Floats, Floats] | None:
        """Return Σ π r²/scale², its half gradient (nv,) and normal matrix (nv, nv); None if no edge has a cost."""
        rows = self.evaluate(q, past, contacts)
        if rows is None:
            return None
        edges, track = list(rows.edges), self.track
        residual = rows.values - np.clip(rows.values, track.lower[0, edges], track.upper[0, edges])
        weight = track.priority[0, edges] / track.scale[edges] ** 2
        weighted = weight[:, None] * rows.slope
        return float(weight @ residual**2), weighted.T @ residual, rows.slope.T @ weighted


class CostModel:
    """The cost of one frame's problem around any configuration, and its inequality rows."""

    problem: Problem
    robot: Robot
    leg: float
    options: SolveOptions
    numeric: list[NumericCost]
    proximity: str
    separation: Proximity | None
    rows: int

    def __init__(self, problem: Problem, options: SolveOptions):
        self.problem, self.robot, self.leg, self.options = problem, problem.robot, problem.leg, options
        costs = [t for t in problem.tracks if t.role is Role.COST and isinstance(t.kind, Numeric)]
        self.numeric = [NumericCost(track, self.robot) for track in costs]
        near = [t for t in problem.tracks if isinstance(t.kind, Nearby)]
        self.proximity = near[0].name if near else ""
        """Name of the kind that keeps surfaces apart."""
        reach = options.reach * self.leg
        self.separation = (
            cast(Nearby, near[0].kind).proximity(near[0], self.robot, problem.match, reach) if near else None
        )
        self.rows = len(problem.inequalities) + (self.separation.most if self.separation else 0)

    def linearize(
        self,
        q: Floats,
        targets: EdgeTargets,
        between: tuple[SweptConfiguration, ...] = (),
        known: LinearizedDistances | None = None,
    ) -> Quadratic:
        """Return costs and inequality rows at a configuration, with the rows of links `between` it and its neighbours.

        Args:
            known: distances of links measured nearby; within `SolveOptions.distance_cache_radius` they are extrapolated along their slopes.
        """
        total, gradient, normal = self.problem.model(q, targets)
        for cost in self.numeric:
            if cost.stencil == FRAME and (found := cost.terms(q, None, None)) is not None:
                total, gradient, normal = total + found[0], gradient + found[1], normal + found[2]
        slope, deficit = self.problem.inequalities.rows(q)
        nv, hard = len(gradient), len(deficit)
        rows, row_lower = np.zeros((self.rows, nv + 1), order="F"), np.full(self.rows, -np.inf)
        rows[:hard, :nv], row_lower[:hard] = slope, deficit
        near = self._near(q, known)
        clearance_deficit = self._apart(q, near, between, rows[hard:], row_lower[hard:]) if near else 0.0
        total += self.options.overlap_cost * clearance_deficit**2
        penetrates_floor = bool(deficit.max(initial=0.0) > self.options.floor_tolerance)
        return Quadratic(total, gradient, normal, rows, row_lower, clearance_deficit, penetrates_floor, near)

    def cost(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> float:
        """The minimised cost of a frame at a configuration."""
        return self.problem.cost(q, targets) + sum(self.parts(q, past).values())

    def parts(self, q: Floats, past: Past | None = None) -> dict[str, float]:
        """Return the cost of each numeric kind; that of surfaces is the cost of their slack."""
        found = {self.proximity: self.separation_cost(q)} if self.separation else {}
        contacts = self._contacts(q) if past is not None else None
        for cost in self.numeric:
            terms = cost.terms(q, past, contacts)
            found[cost.name] = terms[0] if terms else 0.0
        return found

    def separation_cost(self, q: Floats) -> float:
        """Return the cost of links that lack more of their margin than the tolerance."""
        if self.separation is None:
            return 0.0
        distance, _, rest = self.separation.near(q)
        return (
            self.options.overlap_cost * self._clearance_deficit(self.separation.clearance_deficit(distance, rest)) ** 2
        )

    def _contacts(self, q: Floats) -> ContactRows | None:
        """Return the rows of surfaces near each other at a configuration."""
        near = self._near(q, None)
        if near is None or self.separation is None:
            return None
        rows, row_lower = (
            np.zeros((self.separation.most, near.slope.shape[1] + 1)),
            np.full(self.separation.most, -np.inf),
        )
        self._apart(q, near, (), rows, row_lower)
        return ContactRows(rows[:, :-1], row_lower)

    def _clearance_deficit(self, wanted: Floats) -> float:
        """Return how much the nearest links lack beyond the tolerance, over the leg."""
        return max(float(wanted.max(initial=0.0)) - self.options.tolerated * self.leg, 0.0) / self.leg

    def decrease(self, current: Quadratic, step: Floats, slack: float) -> float:
        """By how much the model says that a step (nv) lowers the cost, when links then lack `slack` over the leg."""
        edges = -float(step @ (2 * current.gradient + current.normal @ step))
        return edges + self.options.overlap_cost * (current.clearance_deficit**2 - slack**2)

    def _near(self, q: Floats, known: LinearizedDistances | None) -> LinearizedDistances | None:
        """Return the links near each other: measured at q, or the known ones if measured nearby."""
        if self.separation is None:
            return None
        if (
            known is not None
            and np.abs(difference(self.robot, known.qpos, q)).max() < self.options.distance_cache_radius
        ):
            return known
        return LinearizedDistances(np.array(q), *self.separation.near(q))

    def _apart(
        self,
        q: Floats,
        near: LinearizedDistances,
        between: tuple[SweptConfiguration, ...],
        rows: Floats,
        row_lower: Floats,
    ) -> float:
        """Fill in the rows of near links; how much more than the tolerance the nearest lack, over the leg."""
        distance, slope, rest = self._with_ways(q, near, between)
        assert self.separation is not None
        wanted = self.separation.clearance_deficit(distance, rest)
        count, tolerance = len(distance), self.options.tolerated * self.leg
        rows[:count, :-1], rows[:count, -1] = slope, 1.0
        row_lower[:count] = np.where(wanted > tolerance, wanted, np.minimum(wanted, 0.0))
        return self._clearance_deficit(wanted)

    def _with_ways(
        self, q: Floats, near: LinearizedDistances, between: tuple[SweptConfiguration, ...]
    ) -> tuple[Floats, Floats, Floats]:
        """Return distances, slopes and rests at a configuration and between it and its neighbours.

        A share of the step moves the configurations between frames. Links may touch there: a margin there would bend
        the frames more than the passage needs.
        """
        assert self.separation is not None
        current = near.distance
        if near.qpos is not q:
            current = current + near.slope @ difference(self.robot, near.qpos, q)
        if not between:
            return current, near.slope, near.rest
        found = [(current, near.slope, near.rest)]
        for way in between:
            distance, slope, rest = self.separation.near(way.at(self.robot, q))
            found.append((distance, way.share * slope, np.minimum(rest, 0.0)))
        distance, slope, rest = (np.concatenate(parts) for parts in zip(*found, strict=True))
        kept = self.separation.foremost(distance, rest)
        return distance[kept], slope[kept], rest[kept]

    def with_proximal(self, current: Quadratic, q: Floats, proximal: Proximal | None) -> Quadratic:
        """The model with a proximal term on top."""
        if proximal is None:
            return current
        change = difference(self.robot, proximal.anchor, q) - proximal.offset
        return replace(
            current,
            cost=current.cost + float(proximal.weight @ change**2),
            gradient=current.gradient + proximal.weight * change,
            normal=current.normal + np.diag(proximal.weight),
        )

    def with_past(self, current: Quadratic, q: Floats, past: Past | None) -> Quadratic:
        """The model with the numeric costs that join the frame before on top."""
        joining = [cost for cost in self.numeric if cost.stencil == STEP] if past is not None else []
        if not joining:
            return current
        first = len(self.problem.inequalities)
        contacts = ContactRows(current.rows[first:, :-1], current.row_lower[first:]) if self.separation else None
        for cost in joining:
            if (found := cost.terms(q, past, contacts)) is not None:
                value, pull, curvature = found
                current = replace(
                    current,
                    cost=current.cost + value,
                    gradient=current.gradient + pull,
                    normal=current.normal + curvature,
                )
        return current

    def projected(self, q: Floats) -> Floats:
        """Return the configuration with closed chains and meshed gears."""
        for cost in self.numeric:
            if isinstance(cost.evaluate, Projecting):
                q = cost.evaluate.projected(q)
        return q

    @property
    def projects(self) -> bool:
        """Whether a numeric cost projects configurations exactly."""
        return any(isinstance(cost.evaluate, Projecting) for cost in self.numeric)
