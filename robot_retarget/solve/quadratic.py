"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.graph.role import FRAME, Form, Role
from robot_retarget.graph.rows import ContactRows, MeasureRows, Past, RowState
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.swept import SweptConfiguration
from robot_retarget.solve.options import SolveOptions
from robot_retarget.solve.problem import EdgeTargets, Problem
from robot_retarget.solve.stencils import Neighbours, Terms, terms

TIE = 1e-6
"""Rows whose room differs by less are equal [m]: far above the rounding of distances."""


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
    bound: Floats
    """(C,) least distance of the pairs [m]."""
    edges: Ints
    """(C,) their edges among those of all kinds."""

    @property
    def deficit(self) -> Floats:
        """(C,) bound minus distance [m]."""
        return self.bound - self.distance

    def of(self, kept: Ints) -> "LinearizedDistances":
        """Return some of the pairs."""
        return LinearizedDistances(self.qpos, self.distance[kept], self.slope[kept], self.bound[kept], self.edges[kept])


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


class NumericTrack:
    """A track of a numeric kind, evaluated for one solver."""

    track: Track
    columns: slice

    def __init__(self, problem: Problem, track: Track, reach: float):
        self.problem, self.track, self.columns, self.reach = problem, track, problem.columns[track.name], reach
        self._memory: dict[str, object] = {}

    def state(
        self,
        q: Floats,
        targets: EdgeTargets | None = None,
        past: Past | None = None,
        contacts: ContactRows | None = None,
    ) -> RowState:
        """Return where the kind is evaluated."""
        sides = None if targets is None else (targets.lower, targets.upper, targets.priority)
        own = None if sides is None else (sides[0][self.columns], sides[1][self.columns], sides[2][self.columns])
        return RowState(self.problem.robot, self.problem.match, q, self.reach, past, contacts, own, self._memory)

    def rows(
        self, q: Floats, targets: EdgeTargets, past: Past | None = None, contacts: ContactRows | None = None
    ) -> MeasureRows | None:
        """Return the rows of the kind at a configuration."""
        return self.track.kind.rows(self.track, self.state(q, targets, past, contacts))

    def terms(self, q: Floats, targets: EdgeTargets, past: Past | None, contacts: ContactRows | None) -> Terms | None:
        """Return the terms of a cost; None if no edge has a cost."""
        rows = self.rows(q, targets, past, contacts)
        if rows is None:
            return None
        return terms(self.track, rows.values, rows.slope, targets, self.columns, np.asarray(rows.edges))

    def near(self, q: Floats, targets: EdgeTargets) -> LinearizedDistances:
        """Return the rows of an inequality."""
        rows = self.rows(q, targets) or MeasureRows(
            np.zeros(0), np.zeros((0, self.problem.robot.model.nv)), np.zeros(0, int)
        )
        edges = self.columns.start + np.asarray(rows.edges)
        return LinearizedDistances(q, rows.values, rows.slope, np.minimum(targets.lower[edges], rows.rest), edges)


class CostModel:
    """The cost of one frame's problem around any configuration, and its inequality rows."""

    problem: Problem
    robot: Robot
    leg: float
    options: SolveOptions
    numeric: list[NumericTrack]
    surfaces: list[NumericTrack]
    most: int
    rows: int

    def __init__(self, problem: Problem, options: SolveOptions):
        self.problem, self.robot, self.leg, self.options = problem, problem.robot, problem.leg, options
        reach = options.reach * self.leg
        numeric = [NumericTrack(problem, t, reach) for t in problem.tracks if t.kind.form is Form.NUMERIC]
        self.numeric = [each for each in numeric if each.track.role is Role.COST]
        self.surfaces = [each for each in numeric if each.track.role is Role.INEQUALITY]
        """The kinds that keep surfaces apart; they share one slack."""
        self.most = sum(each.track.kind.most for each in self.surfaces)
        self.rows = len(problem.inequalities) + self.most
        joined = {offset for cost in problem.stencils for offset in cost.offsets}
        self.offsets = joined | {-1 for each in self.numeric if each.track.stencil != FRAME}
        """The frames, relative to one, that share an edge with it."""

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
        own = (cost.terms(q, targets, None, None) for cost in self.numeric if cost.track.stencil == FRAME)
        total, gradient, normal = _sum(self.problem.model(q, targets), own)
        slope, deficit = self.problem.inequalities.rows(q, targets)
        nv, hard = len(gradient), len(deficit)
        rows, row_lower = np.zeros((self.rows, nv + 1), order="F"), np.full(self.rows, -np.inf)
        rows[:hard, :nv], row_lower[:hard] = slope, deficit
        near = self.near(q, targets, known)
        clearance_deficit = 0.0
        if near is not None:
            apart = self._with_ways(q, near, between, targets)
            clearance_deficit = self._fill(apart, rows[hard:], row_lower[hard:])
        total += self.options.overlap_cost * clearance_deficit**2
        penetrates_floor = bool(deficit.max(initial=0.0) > self.options.floor_tolerance)
        return Quadratic(total, gradient, normal, rows, row_lower, clearance_deficit, penetrates_floor, near)

    def cost(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> float:
        """The minimised cost of a frame at a configuration."""
        return self.problem.cost(q, targets) + sum(self.parts(q, targets, past).values())

    def parts(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> dict[str, float]:
        """Return the cost of each numeric kind; that of surfaces is the cost of their slack, at the kind that needs it."""
        found = {each.track.name: 0.0 for each in (*self.surfaces, *self.numeric)}
        lacking = {each.track.name: self._lacking(each.near(q, targets).deficit) for each in self.surfaces}
        if lacking:
            worst = max(lacking, key=lambda name: lacking[name])
            found[worst] = self.options.overlap_cost * lacking[worst] ** 2
        contacts = self._contacts(q, targets) if past is not None else None
        for cost in self.numeric:
            terms = cost.terms(q, targets, past, contacts)
            found[cost.track.name] = terms[0] if terms else 0.0
        return found

    def _contacts(self, q: Floats, targets: EdgeTargets) -> ContactRows | None:
        """Return the rows of surfaces near each other at a configuration."""
        near = self.near(q, targets)
        if near is None:
            return None
        rows, row_lower = np.zeros((self.most, near.slope.shape[1] + 1)), np.full(self.most, -np.inf)
        self._fill(near, rows, row_lower)
        return ContactRows(rows[:, :-1], row_lower)

    def _lacking(self, deficit: Floats) -> float:
        """Return how much the nearest links lack beyond the tolerance, over the leg."""
        return max(float(deficit.max(initial=0.0)) - self.options.tolerated * self.leg, 0.0) / self.leg

    def decrease(self, current: Quadratic, step: Floats, slack: float) -> float:
        """By how much the model says that a step (nv) lowers the cost, when links then lack `slack` over the leg."""
        edges = -float(step @ (2 * current.gradient + current.normal @ step))
        return edges + self.options.overlap_cost * (current.clearance_deficit**2 - slack**2)

    def near(
        self, q: Floats, targets: EdgeTargets, known: LinearizedDistances | None = None
    ) -> LinearizedDistances | None:
        """Return the links near each other: measured at q, or the known ones if measured nearby."""
        if not self.surfaces:
            return None
        radius = self.options.distance_cache_radius
        if known is not None and np.abs(difference(self.robot, known.qpos, q)).max() < radius:
            return known
        return self._foremost([each.near(np.array(q), targets) for each in self.surfaces])

    def _fill(self, near: LinearizedDistances, rows: Floats, row_lower: Floats) -> float:
        """Fill in the rows of near links; how much more than the tolerance the nearest lack, over the leg."""
        count, tolerance, deficit = len(near.distance), self.options.tolerated * self.leg, near.deficit
        rows[:count, :-1], rows[:count, -1] = near.slope, 1.0
        row_lower[:count] = np.where(deficit > tolerance, deficit, np.minimum(deficit, 0.0))
        return self._lacking(deficit)

    def _with_ways(
        self, q: Floats, near: LinearizedDistances, between: tuple[SweptConfiguration, ...], targets: EdgeTargets
    ) -> LinearizedDistances:
        """Return the links near each other at a configuration, and between it and its neighbours.

        A share of the step moves the configurations between frames. Links may touch there: a margin there would bend
        the frames more than the passage needs.
        """
        if near.qpos is not q:
            near = replace(near, distance=near.distance + near.slope @ difference(self.robot, near.qpos, q))
        if not between:
            return near
        found = [near]
        for way in between:
            there = self.near(way.at(self.robot, q), targets)
            assert there is not None
            found.append(replace(there, slope=way.share * there.slope, bound=np.minimum(there.bound, 0.0)))
        return self._foremost(found)

    def _foremost(self, found: list[LinearizedDistances]) -> LinearizedDistances:
        """Return at most `most` of the rows found at one or several configurations."""
        columns = ("distance", "slope", "bound", "edges")
        near = found[0]
        if len(found) > 1:
            near = replace(near, **{name: np.concatenate([getattr(each, name) for each in found]) for name in columns})
            return near.of(foremost(near.distance, near.deficit, self.most))
        return near if len(near.distance) <= self.most else near.of(foremost(near.distance, near.deficit, self.most))

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

    def with_neighbours(self, current: Quadratic, q: Floats, around: Neighbours | None) -> Quadratic:
        """The model with the costs that join a frame with its neighbours on top."""
        if around is None or not self.offsets:
            return current
        first, past = len(self.problem.inequalities), around.past
        contacts = ContactRows(current.rows[first:, :-1], current.row_lower[first:]) if self.surfaces else None
        joining = [cost for cost in self.numeric if cost.track.stencil != FRAME and past is not None]
        found: list[Terms | None] = [cost.terms(q, around.targets[0], past, contacts) for cost in joining]
        found += [each for cost in self.problem.stencils for each in cost.terms(q, around)]
        cost, gradient, normal = _sum((current.cost, current.gradient, current.normal), found)
        return replace(current, cost=cost, gradient=gradient, normal=normal)

    def projected(self, q: Floats) -> Floats:
        """Return the configuration with closed chains and meshed gears; the same array where no kind changes it."""
        return reduce(lambda found, cost: cost.track.kind.projected(cost.track, cost.state(found)), self.numeric, q)

    def overlap(self, q: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m]."""
        return max((each.track.kind.overlap(each.track, each.state(q)) for each in self.surfaces), default=0.0)

    def penetration(self, q: Floats) -> float:
        """Return the depth of the lowest surface under the floor [m]."""
        return max((each.track.kind.penetration(each.track, each.state(q)) for each in self.surfaces), default=0.0)


def _sum(first: Terms, others: Iterable[Terms | None]) -> Terms:
    cost, gradient, normal = first
    for more in others:
        if more is not None:
            cost, gradient, normal = cost + more[0], gradient + more[1], normal + more[2]
    return cost, gradient, normal


def foremost(distance: Floats, deficit: Floats, most: int) -> Ints:
    """Return at most `most` rows, those with the least room to their bound, the nearest first.

    Rows with equal room are kept or dropped together, so that left and right are treated alike.

    Args:
        distance: (C,) [m].
        deficit: (C,) bound minus distance [m].
        most: number of rows.
    """
    order = np.argsort(distance, kind="stable")
    if len(order) <= most:
        return order
    room = -deficit[order]
    kept = room < np.sort(room)[most] - TIE
    return order[kept] if kept.any() else order[np.argsort(room, kind="stable")[:most]]
