"""Edges of one kind over time: their ends are constant, their targets vary."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from robot_retarget.base.arrays import Floats, frozen
from robot_retarget.base.errors import GraphError

# Reasons for which a solver stops.


class Status(Enum):
    """Why a solver stopped, at a frame or for a whole graph; the value is the sentence for a person."""

    CONVERGED = "the step fell below the tolerance"
    OUT_OF_ITERATIONS = "the iterations ran out; the pose is usable, not final"
    BLOCKED = "no further step keeps all limits; the pose is usable, not final"
    CALIBRATING = "the performer is being watched; the robot stands meanwhile"
    HELD = "no frame came; the robot comes to rest"
    UNREACHED = "a hard edge cannot be reached; the pose comes as near as it can"
    FAILED = "the solver's back end failed"


# The printed objectives: the share of one edge in the stress, and its derivatives by the distance.
#
# With d the measured distance of an edge, y the point of [lower, upper] nearest to d and e = d − y (for an exact
# edge y = δ), the objectives are sums over the edges of
#
#     RELATIVE          π |e| / max(y, floor)        [Mucherino2019, eq. 2]
#     RELATIVE_SQUARED  π e² / max(y, floor)²        its smooth variant
#     HALF_SQUARED      ½ π e²                       [MucherinoOmer2019, §1]
#     SQUARED           π e²                         [Mucherino2017, eq. 2]
#
# Edges with a Huber scale g count ϱ(e) = 2 g² (√(1 + (e/g)²) − 1) for e² in the last two.

LEAST_DISTANCE = 1e-3
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
    scale = np.maximum(target, LEAST_DISTANCE)
    if objective is Objective.RELATIVE_SQUARED:
        slope = priority * error / scale**2
        return slope * error, 2.0 * slope, 2.0 * priority / scale**2
    return priority * np.abs(error) / scale, priority * np.sign(error) / scale, np.zeros_like(error)


# Roles, forms and stencils of edges: how the solver treats a kind, how it is measured, and which frames its edges join.

FRAME = (0,)
"""One frame."""
STEP = (-1, 0)
"""A frame and the one before."""
SECOND_DIFFERENCE = (-1, 0, 1)
"""A frame and both neighbours."""
THIRD_DIFFERENCE = (-1, 0, 1, 2)
"""A frame, the one before and the two after."""
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
    """By values and slopes, `Kind.rows`."""
    JOINT = "joint"
    """By the joint coordinates of its ends, and their differences over the stencil."""


if TYPE_CHECKING:
    from robot_retarget.graph.kind import Kind

HARD = 1e4
"""π of a hard edge, over the squared length of a leg [-]: against a cost of 1 with a slope of 1 per leg, it gives way by 5e-5
of a leg."""


SIDES = ("lower", "upper", "priority", "data")
"""The arrays of a track that have a row for every frame."""


@dataclass(frozen=True, eq=False)
class Track:
    """E edges of one kind over T frames.

    An edge measures d(q), a distance between its two ends or the coordinate of their difference along an axis (the limit of
    a distance to a far beacon). Its error is e = (d − y)/scale with y the point of [lower, upper] nearest to d, and it costs

        π ϱ(e),   ϱ(e) = 2 g² (√(1 + (e/g)²) − 1)  (pseudo-Huber of scale g),   e² for g = ∞.
    """

    kind: "Kind"
    ends: tuple[tuple[str, str], ...]
    """(E,) names of both ends."""
    lower: Floats
    upper: Floats
    """(T, E) the target interval [m], [rad] for joints, unitless for directions; equal bounds are exact."""
    priority: Floats
    """(T, E) π, 0 for an absent edge."""
    scale: Floats
    """(E,) scale that makes an error dimensionless, in the unit of the interval."""
    axes: tuple[str, ...] = ()
    """(E,) the axis of a coordinate; empty for distances."""
    huber_delta: float = np.inf
    """g, the Huber scale: errors well above it count linearly [-]."""
    data: Floats = field(default_factory=lambda: np.zeros((1, 0)))
    """(T, D) inputs of the kind's rows that are no targets: poses of bodies, normals of surfaces."""

    def __post_init__(self) -> None:
        frames, edges = np.shape(self.lower)
        for name, columns in zip(SIDES, (edges, edges, edges, np.shape(self.data)[1]), strict=True):
            object.__setattr__(self, name, _column(getattr(self, name), frames, columns))
        object.__setattr__(self, "scale", frozen(np.broadcast_to(self.scale, (edges,))))
        if len(self.ends) != edges:
            raise GraphError(f"{self.name}: {len(self.ends)} pairs of ends for {edges} edges")
        self.refuse(~(self.lower <= self.upper), "has no interval")
        self.refuse(~(self.priority >= 0), "has a priority that is no number of 0 or more")
        if not self.huber_delta > 0:
            raise GraphError(f"{self.name} has the Huber scale {self.huber_delta:g}, which is not above 0")

    def __repr__(self) -> str:
        return f"<Track {self.name}: {len(self.ends)} edges × {len(self.lower)} frames>"

    def refuse(self, wrong: np.ndarray, reason: str) -> None:
        """Raise for the first edge that is wrong.

        Args:
            wrong: (T, E) which edges are.
            reason: the predicate of the message after the edge's name.

        Raises:
            GraphError: an edge is wrong; the message names it, its frame, interval and priority.
        """
        if wrong.any():
            frame, edge = np.argwhere(wrong)[0]
            lower, upper, priority = (getattr(self, name)[frame, edge] for name in ("lower", "upper", "priority"))
            raise GraphError(
                f"{self.edge_name(edge)} {reason} at frame {frame}: {lower:g} … {upper:g}, priority {priority:g}"
            )

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def name(self) -> str:
        """Name of the kind."""
        return self.kind.name

    @property
    def role(self) -> Role:
        """Role of the kind."""
        return self.kind.role

    @property
    def stencil(self) -> tuple[int, ...]:
        """Stencil of the kind."""
        return self.kind.stencil

    @property
    def exact(self) -> bool:
        """Whether every interval is a single value."""
        return bool((self.lower == self.upper).all())

    @property
    def present(self) -> np.ndarray:
        """(T, E) where an edge exists: its priority is above 0, and its stencil stays within the frames."""
        frames = np.arange(len(self.lower))
        inside = (frames + self.stencil[0] >= 0) & (frames + self.stencil[-1] < len(frames))
        return (self.priority > 0) & inside[:, None]

    @property
    def intervals(self) -> tuple[Floats, Floats]:
        """Return lower and upper bounds (T, E) as a solver reads them: an absent limit has none."""
        if self.role is Role.COST or self.priority.all():
            return self.lower, self.upper
        return np.where(self.priority > 0, self.lower, -np.inf), np.where(self.priority > 0, self.upper, np.inf)

    def errors(self, values: Floats) -> Floats:
        """Return (T, E) errors (d − y)/scale of measures (T, E) [-]: negative where a pair is too close."""
        return (values - np.clip(values, self.lower, self.upper)) / self.scale

    def stress(self, values: Floats, objective: Objective = Objective.SQUARED) -> Floats:
        """Return (T, E) the share of every edge in σ.

        Args:
            values: (T, E) measures, in the unit of the interval.
            objective: `SQUARED` is what solvers of robots minimise, π ϱ(e).
        """
        target = np.clip(values, self.lower, self.upper)
        huber_delta = None if np.isinf(self.huber_delta) else self.huber_delta * self.scale
        weight = np.where(self.present, self.priority, 0.0) / self.scale**2
        return edge_terms(objective, values - target, target, weight, huber_delta)[0]

    def edge_name(self, edge: int) -> str:
        """Return a name such as `touch l_hand – head`, with the axis of a coordinate."""
        a, b = self.ends[edge]
        axis = f" ({self.axes[edge]})" if self.axes else ""
        return f"{self.name} {a} – {b}{axis}"

    def joins(self, a: str, b: str) -> np.ndarray:
        """Return (E,) which edges join two ends, in either order.

        Args:
            a: name of an end.
            b: name of the other end.
        """
        return np.array([set(ends) == {a, b} for ends in self.ends], dtype=bool)

    def at(self, frames: slice | Sequence[int] | np.ndarray) -> "Track":
        """Return the same edges at some frames."""
        return replace(self, **{name: getattr(self, name)[frames] for name in SIDES})

    def resampled(self, at: Floats) -> "Track":
        """Return the same edges at fractional frames (K,), interpolated linearly."""
        before = np.minimum(np.asarray(at, dtype=int), len(self.lower) - 1)
        after, share = np.minimum(before + 1, len(self.lower) - 1), (at - before)[:, None]
        columns = {}
        for name in SIDES:
            values = getattr(self, name)
            same = (share == 0) | (values[after] == values[before]) | ~np.isfinite(values[after])
            with np.errstate(invalid="ignore"):
                columns[name] = np.where(same, values[before], (1 - share) * values[before] + share * values[after])
        return replace(self, **columns)

    def subset(self, edges: np.ndarray) -> "Track":
        """Return some of the edges, by a mask or indices."""
        kept = np.arange(len(self))[edges]
        columns = {name: getattr(self, name)[:, kept] for name in ("lower", "upper", "priority")}
        return replace(
            self,
            kind=self.kind.of(kept),
            ends=tuple(self.ends[k] for k in kept),
            axes=tuple(self.axes[k] for k in kept) if self.axes else (),
            scale=self.scale[kept],
            **columns,
        )

    def bounded(self, lower: Floats | float, upper: Floats | float, edges: np.ndarray | slice = slice(None)) -> "Track":
        """Return the track with other intervals for some edges.

        Args:
            lower: broadcast to (T, edges), in the unit of the interval.
            upper: as `lower`.
            edges: a mask or indices of columns.
        """
        bounds = {"lower": np.array(self.lower), "upper": np.array(self.upper)}
        bounds["lower"][:, edges], bounds["upper"][:, edges] = lower, upper
        return replace(self, **bounds)

    def weighed(self, factor: Floats | float, edges: np.ndarray | slice = slice(None)) -> "Track":
        """Return the track with π of some edges multiplied by a factor.

        Args:
            factor: broadcast to (T, edges) [-].
            edges: a mask or indices of columns.
        """
        priority, absent = np.array(self.priority), np.equal(factor, 0)
        priority[:, edges] = np.where(absent, 0.0, priority[:, edges] * np.where(absent, 1.0, factor))
        return replace(self, priority=priority)


def _column(values: Floats, frames: int, edges: int) -> Floats:
    """A read-only column (T, E); one row in memory where all frames have the same values."""
    column = np.broadcast_to(values, (frames, edges))
    same = frames > 0 and (column == column[0]).all()
    return np.broadcast_to(frozen(column[0]), column.shape) if same else frozen(column)


def exact(
    kind: "Kind",
    ends: Sequence[tuple[str, str]],
    target: Floats,
    priority: Floats | float,
    scale: Floats | float = 1.0,
    *,
    axes: Sequence[str] = (),
    huber_delta: float = np.inf,
) -> Track:
    """Edges that targets for one value each (T, E).

    Args:
        ends: (E,) names of both ends.
        target: (T, E) in the unit of the measure.
        priority: π, broadcast to (T, E).
        scale: (E,) or a scalar, in the unit of the measure.
        axes: (E,) axes of coordinates; empty for distances.
        huber_delta: Huber scale of the errors [-].
    """
    weights, scales = np.asarray(priority, dtype=float), np.asarray(scale, dtype=float)
    return Track(kind, tuple(ends), target, target, weights, scales, tuple(axes), huber_delta)


def limit(
    kind: "Kind", ends: Sequence[tuple[str, str]], lower: Floats | float, upper: Floats | float, frames: int
) -> Track:
    """Return edges of an inequality or a bound, without priority.

    Args:
        ends: (E,) names of both ends.
        lower: broadcast to (T, E), in the unit of the measure.
        upper: as `lower`.
        frames: number of frames |T|.
    """
    low = np.broadcast_to(lower, (frames, len(ends)))
    return Track(kind, tuple(ends), low, np.asarray(upper), np.asarray(np.inf), np.ones(len(ends)))


def concatenated(parts: Sequence[Track]) -> Track:
    """Return the same edges over consecutive frames."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in SIDES}
    return replace(parts[0], **columns)


def merged(first: Track, second: Track) -> Track:
    """Return the edges of two tracks of one kind over the same frames.

    Args:
        first: E edges over T frames.
        second: further edges over the same frames.

    Raises:
        GraphError: the tracks are of different kinds or Huber scales.
    """
    if (type(first.kind), first.huber_delta) != (type(second.kind), second.huber_delta):
        raise GraphError(f"tracks of one name {first.name} have other stencils, measures or Huber scales")
    columns = {
        name: np.hstack([getattr(first, name), getattr(second, name)])
        for name in ("lower", "upper", "priority", "scale")
    }
    kind = first.kind.with_edges(second.kind)
    return replace(first, kind=kind, ends=(*first.ends, *second.ends), axes=(*first.axes, *second.axes), **columns)


def frame_costs(tracks: Iterable[Track]) -> list[Track]:
    """Return the tracks of symbolic costs of one frame, which are compiled together."""
    return [t for t in tracks if (t.role, t.kind.form, t.stencil) == (Role.COST, Form.SYMBOLIC, FRAME)]


def ordered(tracks: Sequence[Track]) -> tuple[Track, ...]:
    """Return the tracks in the order in which solvers hold their edges: the symbolic costs of one frame come first."""
    costs = frame_costs(tracks)
    return (*costs, *(track for track in tracks if all(track is not cost for cost in costs)))


def columns_of(tracks: Sequence[Track], side: str = "lower") -> dict[str, slice]:
    """Return the place of each kind's columns in one of `SIDES` of all tracks side by side."""
    ends = np.cumsum([0, *(getattr(track, side).shape[1] for track in tracks)]).tolist()
    return {track.name: slice(*ends[k : k + 2]) for k, track in enumerate(tracks)}
