"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.rows import ContactRows, MeasureRows, Past, RowState, RowStates
from robot_retarget.graph.track import FRAME, Form, Role, Track
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import SweptConfiguration, difference
from robot_retarget.solver.near_links import LinearizedDistances, NearLinks
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import ClipTargets, EdgeTargets, Problem
from robot_retarget.solver.stencils import ClipNeighbours, Neighbours, Terms, terms

Between = Sequence[tuple[SweptConfiguration, ...]]
"""Per frame, configurations between it and its neighbours."""


@dataclass(frozen=True)
class Proximal:
    """Σ w (q ⊖ anchor − offset)²: draws poses towards others, per tangent direction."""

    anchor: Floats
    """(N, nq) or (nq,)."""
    offset: Floats
    """(N, nv) or (nv,)."""
    weight: Floats
    """(nv,)."""

    @property
    def clip(self) -> "Proximal":
        """The term of one frame as that of a clip."""
        return Proximal(self.anchor[None], self.offset[None], self.weight)

    def change(self, robot: Robot, q: Floats) -> Floats:
        """Return (…, nv) how far configurations (…, nq) are from where the term draws them."""
        return difference(robot, self.anchor, q) - self.offset

    def of(self, frames: Ints) -> "Proximal":
        """Return the term of some frames."""
        return Proximal(self.anchor[frames], self.offset[frames], self.weight)


@dataclass(eq=False)
class Quadratic:
    """cost + 2 gᵀv + vᵀNv for small steps v of N frames, with rows v ≥ row_lower; the last variable is the slack of separation."""

    cost: Floats
    """(N,)."""
    gradient: Floats
    """g (N, nv)."""
    normal: Floats
    """N (N, nv, nv)."""
    rows: Floats
    """(N, R, nv + 1)."""
    row_lower: Floats
    """(N, R)."""
    clearance_deficit: Floats
    """(N,) how much more than the tolerance the nearest links lack to their margin, over the leg."""
    penetrates_floor: Bools
    """(N,) whether a sole is under the floor."""
    near: NearLinks
    """The links near each other, at their last measurement."""

    def of(self, frames: Ints) -> "Quadratic":
        """Return some of the frames, which are in order; the model itself where they are all."""
        if len(frames) == len(self.cost):
            return self
        columns: dict[str, Any] = {name: getattr(self, name)[frames] for name in COLUMNS}
        return Quadratic(**columns, near=self.near.of(frames))

    def put(self, frames: Ints, other: "Quadratic", chosen: Bools) -> None:
        """Replace frames by the chosen ones of others; all of them are taken over without a copy."""
        if len(frames) == len(self.cost) and chosen.all():
            vars(self).update(vars(other))
            return
        for name in COLUMNS:
            getattr(self, name)[frames[chosen]] = getattr(other, name)[chosen]
        self.near.replace(frames[chosen], other.near, chosen)


COLUMNS = ("cost", "gradient", "normal", "rows", "row_lower", "clearance_deficit", "penetrates_floor")
"""The arrays of a `Quadratic`."""


class NumericTrack:
    """A track of a numeric kind, evaluated for one solver."""

    track: Track
    columns: slice

    def __init__(self, problem: Problem, track: Track, options: SolveOptions):
        self.problem, self.track, self.columns = problem, track, problem.columns[track.name]
        self.reach, self.threads = options.reach * problem.leg, options.threads
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
        own, edges = self.columns, np.asarray(rows.edges)
        sides = targets.lower[own][edges], targets.upper[own][edges], targets.priority[own][edges]
        return terms(self.track, rows.values, rows.slope, sides, edges)

    def states(self, q: Floats, targets: ClipTargets | None = None) -> RowStates:
        """Return where an inequality is evaluated: at configurations (N, nq)."""
        own = self.columns
        sides = None if targets is None else (targets.lower[:, own], targets.upper[:, own], targets.priority[:, own])
        return RowStates(self.problem.robot, self.problem.match, q, self.reach, sides, self._memory, self.threads)

    def near(self, q: Floats, targets: ClipTargets) -> LinearizedDistances:
        """Return the rows of an inequality at configurations (N, nq)."""
        rows = self.track.kind.clip_rows(self.track, self.states(q, targets))
        edges = self.columns.start + rows.edges
        bound = np.minimum(targets.lower[rows.frame, edges], rows.rest)
        return LinearizedDistances(rows.frame, rows.values, rows.slope, bound, edges)


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
        numeric = [NumericTrack(problem, t, options) for t in problem.tracks if t.kind.form is Form.NUMERIC]
        self.numeric = [each for each in numeric if each.track.role is Role.COST]
        self.alone = [each for each in self.numeric if each.track.stencil == FRAME]
        self.changing = [each for each in self.numeric if each.track.stencil != FRAME]
        self.surfaces = [each for each in numeric if each.track.role is Role.INEQUALITY]
        """The kinds that keep surfaces apart; they share one slack."""
        self.most = sum(each.track.kind.most for each in self.surfaces)
        self.rows = len(problem.inequalities) + self.most
        joined = {offset for cost in problem.stencils for offset in cost.offsets}
        self.offsets = joined | {-1 for _ in self.changing}
        """The frames, relative to one, that share an edge with it."""

    def linearize(
        self, q: Floats, targets: ClipTargets, between: Between | None = None, known: NearLinks | None = None
    ) -> Quadratic:
        """Return costs and inequality rows at configurations (N, nq).

        Args:
            between: per frame, further configurations whose links have rows.
            known: distances of links measured nearby; within `SolveOptions.distance_cache_radius` they are extrapolated along their slopes.
        """
        total, gradient, normal = self._costs(q, targets)
        slope, deficit = self.problem.inequalities.rows(q, targets)
        (count, nv), hard = gradient.shape, deficit.shape[1]
        rows, row_lower = np.zeros((count, self.rows, nv + 1)), np.full((count, self.rows), -np.inf)
        rows[:, :hard, :nv], row_lower[:, :hard] = slope, deficit
        near, apart = self._near(q, targets, known)
        rows[:, hard:, :nv], rows[:, hard:, nv] = near.slope, np.isfinite(apart)
        if between is not None:
            self._with_ways(q, between, targets, rows[:, hard:], apart)
        row_lower[:, hard:], lacking = self.row_lower(apart), self.lacking(apart)
        total += self.options.overlap_cost * lacking**2
        penetrates_floor = deficit.max(axis=1, initial=0.0) > self.options.floor_tolerance
        return Quadratic(total, gradient, normal, rows, row_lower, lacking, penetrates_floor, near)

    def _costs(self, q: Floats, targets: ClipTargets) -> tuple[Floats, Floats, Floats]:
        """Return cost, gradient and normal matrix of the costs of single frames."""
        total, gradient, normal = self.problem.model(q, targets, self.options.threads)
        for k in range(len(q) if self.alone else 0):
            for found in self.terms(q[k], targets.at(k)):
                total[k] += found[0]
                gradient[k] += found[1]
                normal[k] += found[2]
        return total, gradient, normal

    def terms(self, q: Floats, targets: EdgeTargets) -> list[Terms]:
        """Return the terms of the numeric costs of one frame at a configuration (nq,)."""
        return [found for each in self.alone if (found := each.terms(q, targets, None, None)) is not None]

    def _near(self, q: Floats, targets: ClipTargets, known: NearLinks | None) -> tuple[NearLinks, Floats]:
        """Return the links near each other, and their deficits (N, C) [m]; links measured nearby are extrapolated."""
        if known is None:
            near = NearLinks.measured(q, self.measured(q, targets), self.most)
            return near, near.deficit.copy()
        moved = difference(self.robot, known.qpos, q)
        stale = np.flatnonzero(np.abs(moved).max(axis=1) >= self.options.distance_cache_radius)
        if self.surfaces and stale.size:
            known.put(stale, q[stale], self.measured(q[stale], targets.frames(stale)))
            moved[stale] = 0.0
        return known, known.deficit - np.einsum("tcv,tv->tc", known.slope, moved)

    def cost(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> float:
        """The minimised cost of a frame at a configuration."""
        parts = self.parts(q[None], targets.clip, [past])
        return float(self.problem.cost(q, targets)) + float(sum(part[0] for part in parts.values()))

    def parts(self, q: Floats, targets: ClipTargets, past: Sequence[Past | None]) -> dict[str, Floats]:
        """Return the costs (N,) of each numeric kind at configurations (N, nq); of surfaces, that of their slack.

        It is the cost of the kind that needs the slack most.

        Args:
            past: the frame before each; None without it.
        """
        found = {each.track.name: np.zeros(len(q)) for each in (*self.surfaces, *self.numeric)}
        near = [each.near(q, targets) for each in self.surfaces]
        lacking = np.array([self.lacking(each.largest_deficit(len(q))[:, None]) for each in near])
        for k, each in enumerate(self.surfaces):
            worst = lacking.argmax(axis=0) == k
            found[each.track.name][worst] = self.options.overlap_cost * lacking[k, worst] ** 2
        contacts = self._contacts(q, near) if self.numeric and near else [None] * len(q)
        for cost in self.numeric:
            for t, before in enumerate(past):
                terms = cost.terms(q[t], targets.at(t), before, None if before is None else contacts[t])
                found[cost.track.name][t] = terms[0] if terms else 0.0
        return found

    def _contacts(self, q: Floats, near: Sequence[LinearizedDistances]) -> list[ContactRows]:
        """Return the rows of surfaces near each other at each of the configurations (N, nq) at which they are measured."""
        links = NearLinks.measured(q, LinearizedDistances.joined(near), self.most)
        return [ContactRows(*rows) for rows in zip(links.slope, self.row_lower(links.deficit), strict=True)]

    def row_lower(self, deficit: Floats) -> Floats:
        """Return the least change (…) of distances with deficits (…) [m]; a tolerated deficit asks for none."""
        return np.where(deficit > self.options.tolerated * self.leg, deficit, np.minimum(deficit, 0.0))

    def lacking(self, deficit: Floats) -> Floats:
        """Return (…) how much the nearest links lack beyond the tolerance, over the leg, from deficits (…, C) [m]."""
        return np.maximum(deficit.max(axis=-1, initial=0.0) - self.options.tolerated * self.leg, 0.0) / self.leg

    def decrease(self, current: Quadratic, step: Floats, slack: Floats) -> Floats:
        """By how much the model says that steps (N, nv) lower the cost, when links then lack `slack` (N,) over the leg."""
        bent = (current.normal @ step[..., None])[..., 0] + 2 * current.gradient
        return self.options.overlap_cost * (current.clearance_deficit**2 - slack**2) - (bent * step).sum(axis=1)

    def near(self, q: Floats, targets: EdgeTargets) -> LinearizedDistances:
        """Return the links near each other at a configuration (nq,)."""
        return self.measured(q[None], targets.clip).foremost(self.most)

    def measured(self, q: Floats, targets: ClipTargets) -> LinearizedDistances:
        """Return all links near each other at configurations (N, nq)."""
        found = [each.near(q, targets) for each in self.surfaces]
        return LinearizedDistances.joined(found or [LinearizedDistances.none(self.robot.model.nv)])

    def _with_ways(self, q: Floats, between: Between, targets: ClipTargets, rows: Floats, deficit: Floats) -> None:
        """Fill in rows (N, C, nv + 1) and deficits (N, C) of frames with ways: of links there and on the ways.

        A share of the step moves the configurations between frames. Links may touch there: a margin there would bend
        the frames more than the passage needs.
        """
        frames = np.flatnonzero([bool(ways) for ways in between])
        if not frames.size:
            return
        ways = [(k, way.share, way.at(self.robot, q[t])) for k, t in enumerate(frames.tolist()) for way in between[t]]
        owner, share = np.array([way[0] for way in ways]), np.array([way[1] for way in ways])
        there = self.measured(np.array([way[2] for way in ways]), targets.frames(frames[owner]))
        there = replace(
            there,
            frame=owner[there.frame],
            slope=share[there.frame, None] * there.slope,
            bound=np.minimum(there.bound, 0.0),
        )
        found = LinearizedDistances.joined([self.measured(q[frames], targets.frames(frames)), there])
        near = NearLinks.measured(q[frames], found, self.most)
        deficit[frames], rows[frames, :, :-1], rows[frames, :, -1] = near.deficit, near.slope, np.isfinite(near.deficit)

    def with_proximal(self, current: Quadratic, q: Floats, proximal: Proximal | None) -> Quadratic:
        """The model with a proximal term on top."""
        if proximal is None:
            return current
        change, weight = proximal.change(self.robot, q), proximal.weight
        normal = current.normal.copy()
        diagonal(normal)[:] += weight
        columns: dict[str, Any] = {
            **vars(current),
            "cost": current.cost + change * change @ weight,
            "gradient": current.gradient + weight * change,
            "normal": normal,
        }
        return Quadratic(**columns)

    def with_neighbours(self, current: Quadratic, q: Floats, around: ClipNeighbours | Neighbours | None) -> Quadratic:
        """The model with the costs that join frames with their neighbours on top."""
        if around is None or not (self.offsets if around.alone else self.changing):
            return current
        total = [current.cost.copy(), current.gradient.copy(), current.normal.copy()]
        first = len(self.problem.inequalities)
        for k in range(len(q) if self.changing else 0):
            contacts = ContactRows(current.rows[k, first:, :-1], current.row_lower[k, first:])
            for found in self.since(contacts, q[k], around.at(k)):
                for sums, part in zip(total, found, strict=True):
                    sums[k] += part
        for cost in self.problem.stencils if around.alone else ():
            for sums, part in zip(total, cost.terms(q, around), strict=True):
                sums += part
        return replace(current, cost=total[0], gradient=total[1], normal=total[2])

    def joining(self, contacts: ContactRows, q: Floats, around: Neighbours) -> list[Terms]:
        """Return the terms that join a frame at a configuration (nq,) with its neighbours."""
        joined = [cost.terms(q[None], around) for cost in self.problem.stencils]
        return [*self.since(contacts, q, around), *((cost[0], pull[0], weight[0]) for cost, pull, weight in joined)]

    def since(self, contacts: ContactRows, q: Floats, around: Neighbours) -> list[Terms]:
        """Return the terms of numeric costs that join a frame at a configuration (nq,) with the frame before."""
        past, known = around.past, contacts if self.surfaces else None
        if past is None:
            return []
        found = [cost.terms(q, around.targets[0], past, known) for cost in self.changing]
        return [each for each in found if each is not None]

    def projected(self, q: Floats) -> Floats:
        """Return the configuration with closed chains and meshed gears; the same array where no kind changes it."""
        return reduce(lambda found, cost: cost.track.kind.projected(cost.track, cost.state(found)), self.numeric, q)

    def overlap(self, q: Floats) -> Floats:
        """Return the depths (N,) of the deepest overlaps of two links at configurations (N, nq) [m]."""
        depths = (each.track.kind.overlap(each.track, each.states(q)) for each in self.surfaces)
        return reduce(np.maximum, depths, np.zeros(len(q)))

    def penetration(self, q: Floats) -> Floats:
        """Return the depths (N,) of the lowest surfaces under the floor at configurations (N, nq) [m]."""
        depths = (each.track.kind.penetration(each.track, each.states(q)) for each in self.surfaces)
        return reduce(np.maximum, depths, np.zeros(len(q)))


def diagonal(matrices: Floats) -> Floats:
    """Return the view (…, n) of the diagonals of contiguous matrices (…, n, n)."""
    return matrices.reshape(*matrices.shape[:-2], -1)[..., :: matrices.shape[-1] + 1]
