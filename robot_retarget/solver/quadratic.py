"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.rows import ClipRows, RowState
from robot_retarget.graph.track import Form, Role, Track, columns_of
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import SweptConfiguration, difference
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.near_links import NearLinks, foremost
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import Problem

Terms = tuple[Floats, Floats, Floats]
"""Costs (…), halves of their gradients (…, nv) and their normal matrices (…, nv, nv)."""
Sides = tuple[Floats, Floats, Floats]
"""Lower bounds, upper bounds and priorities (…, E) of the edges of a track."""
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

    def change(self, robot: Robot, q: Floats) -> Floats:
        """Return (…, nv) how far configurations (…, nq) are from where the term draws them."""
        return difference(robot, self.anchor, q) - self.offset

    def at(self, frames: Ints | None) -> "Proximal":
        """Return the term of some frames; None makes that of a clip of one frame."""
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
    """(N, R) bound minus distance [m]."""
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
        self._data: slice = columns_of(problem.tracks, "data")[track.name]
        self.reach, self.threads = options.reach * problem.leg, options.threads
        self._memory: dict[str, object] = {}

    def state(self, q: Floats, targets: Targets | None = None) -> RowState:
        """Return where the kind is evaluated: at configurations (…, nq)."""
        sides = None
        if targets is not None:
            own = (..., self.columns)
            sides = targets.lower[own], targets.upper[own], targets.priority[own], targets.data[..., self._data]
        return RowState(self.problem.robot, self.problem.match, q, self.reach, sides, self._memory, self.threads)

    def terms(self, q: Floats, targets: Targets) -> Terms | None:
        """Return the terms of a cost; None if no edge has a cost."""
        rows = self.track.kind.rows(self.track, self.state(q, targets))
        if rows is None:
            return None
        own, edges = self.columns, np.asarray(rows.edges)
        sides = targets.lower[own][edges], targets.upper[own][edges], targets.priority[own][edges]
        return terms(self.track, rows.values, rows.slope, sides, edges)

    def near(self, q: Floats, targets: Targets) -> ClipRows:
        """Return the rows of an inequality at configurations (N, nq)."""
        rows = self.track.kind.clip_rows(self.track, self.state(q, targets))
        edges = self.columns.start + rows.edges
        return replace(rows, edges=edges, rest=np.minimum(targets.lower[rows.frame, edges], rows.rest))


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
        self.work: Counter[str] = Counter()
        """Frames that were linearised, and those whose links were measured."""
        numeric = [NumericTrack(problem, t, options) for t in problem.tracks if t.kind.form is Form.NUMERIC]
        self.numeric = [each for each in numeric if each.track.role is Role.COST]
        self.surfaces = [each for each in numeric if each.track.role is Role.INEQUALITY]
        """The kinds that keep surfaces apart; they share one slack."""
        self.most = sum(each.track.kind.most for each in self.surfaces)
        self.rows = len(problem.inequalities) + self.most

    def linearize(
        self, q: Floats, targets: Targets, between: Between | None = None, known: NearLinks | None = None
    ) -> Quadratic:
        """Return costs and inequality rows at configurations (N, nq).

        Args:
            between: per frame, further configurations whose links have rows.
            known: distances of links measured nearby, of the first frames; within `SolveOptions.distance_cache_radius` they are extrapolated
                along their slopes.
        """
        self.work["linearised"] += len(q)
        total, gradient, normal = self._costs(q, targets)
        slope, deficit = self.problem.inequalities.rows(q, targets)
        (count, nv), hard = gradient.shape, deficit.shape[1]
        rows, row_lower = np.zeros((count, self.rows, nv + 1)), np.full((count, self.rows), -np.inf)
        rows[:, :hard, :nv], row_lower[:, :hard] = slope, deficit
        near, apart = self._near(q, targets, known)
        rows[:, hard:, :nv], rows[:, hard:, nv] = near.slope, np.isfinite(apart)
        if between is not None:
            self._with_ways(q, between, targets, rows[:, hard:], apart)
        row_lower[:, hard:], lacking = apart, self.lacking(apart)
        total += self.options.overlap_cost * lacking**2
        penetrates_floor = deficit.max(axis=1, initial=0.0) > self.options.floor_tolerance
        return Quadratic(total, gradient, normal, rows, row_lower, lacking, penetrates_floor, near)

    def _costs(self, q: Floats, targets: Targets) -> tuple[Floats, Floats, Floats]:
        """Return cost, gradient and normal matrix of the costs of single frames."""
        total, gradient, normal = self.problem.model(q, targets, self.options.threads)
        for k in range(len(q) if self.numeric else 0):
            for found in self.terms(q[k], targets.at(k)):
                total[k] += found[0]
                gradient[k] += found[1]
                normal[k] += found[2]
        return total, gradient, normal

    def terms(self, q: Floats, targets: Targets) -> list[Terms]:
        """Return the terms of the numeric costs of one frame at a configuration (nq,)."""
        return [found for each in self.numeric if (found := each.terms(q, targets)) is not None]

    def _near(self, q: Floats, targets: Targets, known: NearLinks | None) -> tuple[NearLinks, Floats]:
        """Return the links near each other, and their deficits (N, C) [m]; links measured nearby are extrapolated."""
        if known is None:
            near = NearLinks.measured(q, self.measured(q, targets), self.most)
            return near, near.deficit.copy()
        if len(known) < len(q):
            added = np.arange(len(known), len(q))
            known = known.followed_by(self._near(q[added], targets.at(added), None)[0])
        moved, deficit = known.extrapolated(self.robot, q)
        touching = deficit.max(axis=1, initial=-np.inf) > 0.0
        radius = np.where(touching, self.options.touching_cache_radius, self.options.distance_cache_radius)
        stale = np.flatnonzero(moved >= radius)
        if self.surfaces and stale.size:
            known.put(stale, q[stale], self.measured(q[stale], targets.at(stale)))
            deficit[stale] = known.deficit[stale]
        return known, deficit

    def cost(self, q: Floats, targets: Targets) -> float:
        """The minimised cost of a frame at a configuration."""
        parts = self.parts(q[None], targets.at(None))
        return float(self.problem.cost(q, targets)) + float(sum(part[0] for part in parts.values()))

    def parts(self, q: Floats, targets: Targets) -> dict[str, Floats]:
        """Return the costs (N,) of each numeric kind at configurations (N, nq); of surfaces, that of their slack.

        It is the cost of the kind that needs the slack most.
        """
        found = {each.track.name: np.zeros(len(q)) for each in (*self.surfaces, *self.numeric)}
        near = [NearLinks.measured(q, each.near(q, targets), self.most) for each in self.surfaces]
        lacking = np.array([self.lacking(each.deficit) for each in near])
        for k, each in enumerate(self.surfaces):
            worst = lacking.argmax(axis=0) == k
            found[each.track.name][worst] = self.options.overlap_cost * lacking[k, worst] ** 2
        for cost in self.numeric:
            for t, own in enumerate(q):
                terms = cost.terms(own, targets.at(t))
                found[cost.track.name][t] = terms[0] if terms else 0.0
        return found

    def row_lower(self, deficit: Floats) -> Floats:
        """Return the least change (…) of distances with deficits (…) [m]; a tolerated deficit asks for none."""
        return np.where(deficit > self.options.tolerated * self.leg, deficit, np.minimum(deficit, 0.0))

    def tolerant(self, row_lower: Floats) -> Floats:
        """Return the bounds of rows (N, R) of a model, which ask for no change where links lack a tolerated deficit."""
        hard = len(self.problem.inequalities)
        return np.concatenate([row_lower[:, :hard], self.row_lower(row_lower[:, hard:])], axis=1)

    def lacking(self, deficit: Floats) -> Floats:
        """Return (…) how much the nearest links lack beyond the tolerance, over the leg, from deficits (…, C) [m]."""
        return np.maximum(deficit.max(axis=-1, initial=0.0) - self.options.tolerated * self.leg, 0.0) / self.leg

    def decrease(self, current: Quadratic, step: Floats, slack: Floats) -> Floats:
        """By how much the model says that steps (N, nv) lower the cost, when links then lack `slack` (N,) over the leg."""
        bent = (current.normal @ step[..., None])[..., 0] + 2 * current.gradient
        return self.options.overlap_cost * (current.clearance_deficit**2 - slack**2) - (bent * step).sum(axis=1)

    def near(self, q: Floats, targets: Targets) -> ClipRows:
        """Return the links near each other at a configuration (nq,)."""
        return foremost(self.measured(q[None], targets.at(None)), self.most)

    def measured(self, q: Floats, targets: Targets) -> ClipRows:
        """Return all links near each other at configurations (N, nq)."""
        self.work["measured"] += len(q)
        found = [each.near(q, targets) for each in self.surfaces]
        return ClipRows.joined(found or [ClipRows.of([None], self.robot.model.nv)])

    def _with_ways(self, q: Floats, between: Between, targets: Targets, rows: Floats, deficit: Floats) -> None:
        """Fill in rows (N, C, nv + 1) and deficits (N, C) of frames with ways: of links there and on the ways.

        A share of the step moves the configurations between frames. Links may touch there: a margin there would bend
        the frames more than the passage needs.
        """
        frames = np.flatnonzero([bool(ways) for ways in between])
        if not frames.size:
            return
        ways = [(k, way.share, way.at(self.robot, q[t])) for k, t in enumerate(frames.tolist()) for way in between[t]]
        owner, share = np.array([way[0] for way in ways]), np.array([way[1] for way in ways])
        there = self.measured(np.array([way[2] for way in ways]), targets.at(frames[owner]))
        there = replace(
            there,
            frame=owner[there.frame],
            slope=share[there.frame, None] * there.slope,
            rest=np.minimum(there.rest, 0.0),
        )
        found = ClipRows.joined([self.measured(q[frames], targets.at(frames)), there])
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

    def projected(self, q: Floats) -> Floats:
        """Return the configuration with closed chains and meshed gears; the same array where no kind changes it."""
        return reduce(lambda found, cost: cost.track.kind.projected(cost.track, cost.state(found)), self.numeric, q)

    def overlap(self, q: Floats) -> Floats:
        """Return the depths (N,) of the deepest overlaps of two links at configurations (N, nq) [m]."""
        self.work["measured"] += len(q)
        depths = (each.track.kind.overlap(each.track, each.state(q)) for each in self.surfaces)
        return reduce(np.maximum, depths, np.zeros(len(q)))

    def penetration(self, q: Floats) -> Floats:
        """Return the depths (N,) of the lowest surfaces under the floor at configurations (N, nq) [m]."""
        depths = (each.track.kind.penetration(each.track, each.state(q)) for each in self.surfaces)
        return reduce(np.maximum, depths, np.zeros(len(q)))


def diagonal(matrices: Floats) -> Floats:
    """Return the view (…, n) of the diagonals of contiguous matrices (…, n, n)."""
    return matrices.reshape(*matrices.shape[:-2], -1)[..., :: matrices.shape[-1] + 1]


def terms(track: Track, values: Floats, slope: Floats, sides: Sides, edges: np.ndarray) -> Terms:
    """Return Σ π ϱ(e) of rows of a track, its half gradient and normal matrix, by reweighted least squares.

    Args:
        track: gives scales and the Huber scale.
        values: (R,) measures.
        slope: (R, nv) their Jacobian.
        sides: (R,) targets of the rows.
        edges: (R,) the edge of every row.
    """
    (lower, upper, priority), scale = sides, track.scale[edges]
    residual = values - np.clip(values, lower, upper)
    weight = np.where((values > lower) & (values < upper), 0.0, priority / scale**2)
    cost = weight * residual**2
    if np.isfinite(track.huber_delta):
        root = np.sqrt(1 + (residual / (scale * track.huber_delta)) ** 2)
        cost, weight = 2 * track.huber_delta**2 * priority * (root - 1), weight / root
    return cost.sum(), slope.T @ (weight * residual), slope.T @ (weight[:, None] * slope)
