"""The quadratic model of a frame's cost around a configuration, and the rows that bound a step from it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from robot_retarget.arrays import Bools, Floats, Ints
from robot_retarget.graph.role import FRAME, Form, Role
from robot_retarget.graph.rows import ContactRows, MeasureRows, Past, RowState
from robot_retarget.graph.track import Track
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.swept import SweptConfiguration
from robot_retarget.solve.options import SolveOptions
from robot_retarget.solve.problem import ClipTargets, EdgeTargets, Problem
from robot_retarget.solve.stencils import Neighbours, Terms, terms

Between = Sequence[tuple[SweptConfiguration, ...]]
"""Per frame, configurations between it and its neighbours."""
EQUAL = 1e-9
"""Rows whose distance and slope differ by less, in a fixed mixture, are one row [m]."""
TIE = 1e-6
"""Rows whose room differs by less are equal [m]: far above the rounding of distances."""


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

    def of(self, frames: Ints) -> "Proximal":
        """Return the term of some frames."""
        return Proximal(self.anchor[frames], self.offset[frames], self.weight)


@dataclass(frozen=True, eq=False)
class LinearizedDistances:
    """Distances of links near each other, measured at a configuration."""

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
        return LinearizedDistances(self.distance[kept], self.slope[kept], self.bound[kept], self.edges[kept])


class NearLinks:
    """Distances of links near each other of N frames, each measured at a configuration; absent ones are infinite."""

    def __init__(self, qpos: Floats, most: int, nv: int):
        count = len(qpos)
        self.qpos = qpos.copy()
        """(N, nq)."""
        self.deficit = np.full((count, most), -np.inf)
        """(N, C) bound minus distance [m]."""
        self.slope = np.zeros((count, most, nv))
        """(N, C, nv) derivative of the distances by the tangent vector."""

    def of(self, frames: Ints) -> "NearLinks":
        """Return some of the frames."""
        found = NearLinks.__new__(NearLinks)
        found.qpos, found.deficit, found.slope = self.qpos[frames], self.deficit[frames], self.slope[frames]
        return found

    def replace(self, frames: Ints, other: "NearLinks", chosen: Bools) -> None:
        """Replace frames by the chosen ones of others."""
        for name in ("qpos", "deficit", "slope"):
            getattr(self, name)[frames] = getattr(other, name)[chosen]

    def put(self, frame: int, qpos: Floats, found: LinearizedDistances) -> None:
        """Store the links of a frame."""
        count = len(found.distance)
        self.qpos[frame] = qpos
        self.deficit[frame, :count], self.slope[frame, :count] = found.deficit, found.slope
        self.deficit[frame, count:], self.slope[frame, count:] = -np.inf, 0.0


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
        return LinearizedDistances(rows.values, rows.slope, np.minimum(targets.lower[edges], rows.rest), edges)


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
        for k in np.flatnonzero([bool(ways) for ways in between or ()]).tolist():
            apart[k] = self._with_ways(q[k], between[k], targets.at(k), rows[k, hard:])  # pyright: ignore[reportOptionalSubscript]
        row_lower[:, hard:] = np.where(apart > self.options.tolerated * self.leg, apart, np.minimum(apart, 0.0))
        lacking = self._lacking(apart)
        total += self.options.overlap_cost * lacking**2
        penetrates_floor = deficit.max(axis=1, initial=0.0) > self.options.floor_tolerance
        return Quadratic(total, gradient, normal, rows, row_lower, lacking, penetrates_floor, near)

    def _costs(self, q: Floats, targets: ClipTargets) -> tuple[Floats, Floats, Floats]:
        """Return cost, gradient and normal matrix of the costs of single frames."""
        total, gradient, normal = self.problem.model(q, targets)
        for cost in self.numeric:
            for k in range(len(q) if cost.track.stencil == FRAME else 0):
                if (found := cost.terms(q[k], targets.at(k), None, None)) is not None:
                    total[k] += found[0]
                    gradient[k] += found[1]
                    normal[k] += found[2]
        return total, gradient, normal

    def _near(self, q: Floats, targets: ClipTargets, known: NearLinks | None) -> tuple[NearLinks, Floats]:
        """Return the links near each other, and their deficits (N, C) [m]; links measured nearby are extrapolated."""
        if known is None:
            near, moved = NearLinks(q, self.most, self.robot.model.nv), np.zeros((len(q), self.robot.model.nv))
            stale = range(len(q))
        else:
            near, moved = known, difference(self.robot, known.qpos, q)
            stale = np.flatnonzero(np.abs(moved).max(axis=1) >= self.options.distance_cache_radius).tolist()
        for k in stale if self.surfaces else ():
            near.put(k, q[k], self.near(q[k], targets.at(k)))
            moved[k] = 0.0
        return near, near.deficit - np.einsum("tcv,tv->tc", near.slope, moved)

    def cost(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> float:
        """The minimised cost of a frame at a configuration."""
        return float(self.problem.cost(q, targets)) + sum(self.parts(q, targets, past).values())

    def parts(self, q: Floats, targets: EdgeTargets, past: Past | None = None) -> dict[str, float]:
        """Return the cost of each numeric kind; that of surfaces is the cost of their slack, at the kind that needs it."""
        found = {each.track.name: 0.0 for each in (*self.surfaces, *self.numeric)}
        lacking = {each.track.name: float(self._lacking(each.near(q, targets).deficit)) for each in self.surfaces}
        if lacking:
            worst = max(lacking, key=lambda name: lacking[name])
            found[worst] = self.options.overlap_cost * lacking[worst] ** 2
        contacts = self._contacts(q, targets) if self.numeric and past is not None else None
        for cost in self.numeric:
            terms = cost.terms(q, targets, past, contacts)
            found[cost.track.name] = terms[0] if terms else 0.0
        return found

    def _contacts(self, q: Floats, targets: EdgeTargets) -> ContactRows | None:
        """Return the rows of surfaces near each other at a configuration."""
        if not self.surfaces:
            return None
        near, tolerance = self.near(q, targets), self.options.tolerated * self.leg
        return ContactRows(near.slope, np.where(near.deficit > tolerance, near.deficit, np.minimum(near.deficit, 0.0)))

    def _lacking(self, deficit: Floats) -> Floats:
        """Return (…) how much the nearest links lack beyond the tolerance, over the leg, from deficits (…, C) [m]."""
        return np.maximum(deficit.max(axis=-1, initial=0.0) - self.options.tolerated * self.leg, 0.0) / self.leg

    def decrease(self, current: Quadratic, step: Floats, slack: Floats) -> Floats:
        """By how much the model says that steps (N, nv) lower the cost, when links then lack `slack` (N,) over the leg."""
        bent = (current.normal @ step[..., None])[..., 0] + 2 * current.gradient
        return self.options.overlap_cost * (current.clearance_deficit**2 - slack**2) - (bent * step).sum(axis=1)

    def near(self, q: Floats, targets: EdgeTargets) -> LinearizedDistances:
        """Return the links near each other at a configuration."""
        return self._foremost([each.near(q, targets) for each in self.surfaces])

    def _with_ways(
        self, q: Floats, between: tuple[SweptConfiguration, ...], targets: EdgeTargets, rows: Floats
    ) -> Floats:
        """Fill in the rows (C, nv + 1) of links at a configuration, and between it and its neighbours; return their deficits (C,).

        A share of the step moves the configurations between frames. Links may touch there: a margin there would bend
        the frames more than the passage needs.
        """
        found = [self.near(q, targets)]
        for way in between:
            there = self.near(way.at(self.robot, q), targets)
            found.append(replace(there, slope=way.share * there.slope, bound=np.minimum(there.bound, 0.0)))
        near, deficit = self._foremost(found), np.full(self.most, -np.inf)
        count = len(near.distance)
        deficit[:count], rows[:] = near.deficit, 0.0
        rows[:count, :-1], rows[:count, -1] = near.slope, 1.0
        return deficit

    def _foremost(self, found: list[LinearizedDistances]) -> LinearizedDistances:
        """Return at most `most` of the rows found at one or several configurations, each once."""
        columns = ("distance", "slope", "bound", "edges")
        near = found[0]
        if len(found) > 1:
            near = replace(near, **{name: np.concatenate([getattr(each, name) for each in found]) for name in columns})
        if len(near.distance) <= self.most:
            return near if len(found) == 1 else near.of(np.argsort(near.distance, kind="stable"))
        near = near.of(_distinct(near))
        return near.of(tightest_rows(near.distance, near.deficit, self.most))

    def with_proximal(self, current: Quadratic, q: Floats, proximal: Proximal | None) -> Quadratic:
        """The model with a proximal term on top."""
        if proximal is None:
            return current
        change, weight = difference(self.robot, proximal.anchor, q) - proximal.offset, proximal.weight
        normal = current.normal.copy()
        diagonal(normal)[:] += weight
        columns: dict[str, Any] = {
            **vars(current),
            "cost": current.cost + change**2 @ weight,
            "gradient": current.gradient + weight * change,
            "normal": normal,
        }
        return Quadratic(**columns)

    def with_neighbours(self, current: Quadratic, q: Floats, around: Sequence[Neighbours | None] | None) -> Quadratic:
        """The model with the costs that join frames with their neighbours on top."""
        if around is None or not self.offsets:
            return current
        total = [current.cost.copy(), current.gradient.copy(), current.normal.copy()]
        for k, own in enumerate(around):
            for found in self._joining(current, k, q[k], own) if own is not None else ():
                for sums, part in zip(total, found, strict=True):
                    sums[k] += part
        return replace(current, cost=total[0], gradient=total[1], normal=total[2])

    def _joining(self, current: Quadratic, k: int, q: Floats, around: Neighbours) -> Iterator[Terms]:
        """Yield the terms that join one of the frames with its neighbours."""
        first, past = len(self.problem.inequalities), around.past
        contacts = ContactRows(current.rows[k, first:, :-1], current.row_lower[k, first:]) if self.surfaces else None
        for cost in self.numeric if past is not None else ():
            if cost.track.stencil != FRAME and (found := cost.terms(q, around.targets[0], past, contacts)) is not None:
                yield found
        for cost in self.problem.stencils:
            yield from cost.terms(q, around)

    def projected(self, q: Floats) -> Floats:
        """Return the configuration with closed chains and meshed gears; the same array where no kind changes it."""
        return reduce(lambda found, cost: cost.track.kind.projected(cost.track, cost.state(found)), self.numeric, q)

    def overlap(self, q: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m]."""
        return max((each.track.kind.overlap(each.track, each.state(q)) for each in self.surfaces), default=0.0)

    def penetration(self, q: Floats) -> float:
        """Return the depth of the lowest surface under the floor [m]."""
        return max((each.track.kind.penetration(each.track, each.state(q)) for each in self.surfaces), default=0.0)


def diagonal(matrices: Floats) -> Floats:
    """Return the view (N, n) of the diagonals of contiguous matrices (N, n, n)."""
    return matrices.reshape(len(matrices), -1)[:, :: matrices.shape[1] + 1]


def _distinct(near: LinearizedDistances) -> Ints:
    """Return the first of every set of equal rows: geoms that occur twice leave room for no fewer others."""
    mixed = near.slope @ np.cos(np.arange(near.slope.shape[1])) + near.distance
    order = np.argsort(mixed, kind="stable")
    return np.sort(order[np.diff(mixed[order], prepend=-np.inf) > EQUAL])


def tightest_rows(distance: Floats, deficit: Floats, most: int) -> Ints:
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
