"""The graph of a dynamical distance geometry problem, G = (V × T, E, {δ, π}), as tracks of edges.

A track holds the edges of one kind: their ends once, their intervals and priorities frame by frame. A realization
measures the edges. `points.PointGraph` has coordinates of free points, `describe.RobotGraph` joint coordinates.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.base.errors import GraphError, known
from robot_retarget.graph.track import FRAME, HARD, Role, Track

ROW = np.dtype(
    [
        ("kind", "U16"),
        ("a", "U48"),
        ("b", "U48"),
        ("axis", "U8"),
        ("frame", np.int64),
        ("lower", np.float64),
        ("upper", np.float64),
        ("priority", np.float64),
        ("hard", np.bool_),
    ]
)


@dataclass(frozen=True)
class EdgeError:
    """An edge at a frame."""

    name: str
    frame: int
    target: float
    """y, the point of the interval nearest to the measure."""
    measured: float
    error: float
    """(d − y)/scale [-]."""
    priority: float

    def __repr__(self) -> str:
        values = (
            f"target {self.target:.3g}, measured {self.measured:.3g}, error {self.error:.3g}, π {self.priority:.3g}"
        )
        return f"<EdgeError {self.name} at frame {self.frame}: {values}>"


@dataclass(frozen=True, eq=False)
class Graph:
    """Tracks of edges over the same T frames."""

    tracks: tuple[Track, ...]
    """One per kind; hard edges have the priority `track.HARD`, limits ∞."""

    def __len__(self) -> int:
        """|T|."""
        return len(self.tracks[0].lower)

    @property
    def kinds(self) -> dict[str, Track]:
        """All tracks by the name of their kind."""
        return {track.name: track for track in self.tracks}

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """The names of all ends."""
        return tuple(dict.fromkeys(end for t in self.tracks for pair in t.ends for end in pair))

    def between(self, a: str, b: str) -> dict[str, Track]:
        """Return the edges that join two ends, by kind.

        Args:
            a: name of an end.
            b: name of the other end.

        Raises:
            GraphError: an end is unknown.
        """
        self._require_known((a, b))
        return {track.name: track.subset(joined) for track in self.tracks if (joined := track.joins(a, b)).any()}

    def table(self, frames: ArrayLike | None = None) -> np.ndarray:
        """Return the expansion over V × T as a structured array: kind, a, b, axis, frame, lower, upper, priority, hard.

        Args:
            frames: the frames to include; an edge without priority at a frame is absent there.
        """
        chosen = np.arange(len(self)) if frames is None else np.atleast_1d(np.asarray(frames, dtype=int))
        return np.concatenate([_table_rows(track, chosen) for track in self.tracks])

    def costliest(self, measured: Mapping[str, Floats], count: int) -> list[EdgeError]:
        """Return the edges with the largest cost over all frames, each at its worst frame.

        Args:
            measured: per kind (T, E) the measures of a realization.
            count: number of edges.
        """
        found = []
        for name, values in measured.items():
            track = self.kinds[name]
            loss, errors = track.stress(values), track.errors(values)
            for e in np.argsort(-loss.sum(axis=0))[:count]:
                t = int(loss[:, e].argmax())
                target = float(np.clip(values[t, e], track.lower[t, e], track.upper[t, e]))
                worst = float(values[t, e]), float(errors[t, e]), float(track.priority[t, e])
                found.append((float(loss[:, e].sum()), EdgeError(track.edge_name(int(e)), t, target, *worst)))
        return [edge for _, edge in sorted(found, key=lambda item: -item[0])[:count]]

    def with_priority(self, what: str | tuple[str, str], factor: float) -> Self:
        """Return the graph with the priority of a kind, or of the edges between two ends, multiplied by a factor.

        Args:
            what: a kind, or two ends.
            factor: 0 or more.

        Raises:
            GraphError: an unknown kind or end, a factor below 0, or a limit, which has no priority.
        """
        if not 0 <= factor < np.inf:
            raise GraphError(f"a priority is multiplied by a factor of 0 or more, got {factor}")
        refusal = f"{what} is a limit, which has no priority; `with_bounds` moves it"
        return self._changed(what, lambda track, edges: track.weighed(factor, edges), _is_cost, refusal)

    def with_bounds(
        self,
        what: str | tuple[str, str],
        lower: float | None = None,
        upper: float | None = None,
        *,
        factor: float = 1.0,
    ) -> Self:
        """Return the graph with other bounds of a limit or of added edges: margins, speed shares, narrower ranges.

        Args:
            what: a kind, or two ends.
            lower: in the unit of the kind, in place of the present bound.
            upper: the same for the upper bound.
            factor: multiplies both bounds afterwards, e.g. .8 for four fifths of all joint speeds.

        Raises:
            GraphError: an unknown kind or end, targets that follow the human's motion, a bound beyond the robot's own, or
                an empty interval.
        """
        refusal = f"the targets of {what} follow the human's motion; `with_priority` weighs them"
        return self._changed(what, lambda t, edges: _rebounded(t, edges, lower, upper, factor), self._is_free, refusal)

    def without(self, what: str | tuple[str, str]) -> Self:
        """Return the graph without a kind, or without the edges between two ends.

        Raises:
            GraphError: an unknown kind or end, or joint ranges, which protect the robot.
        """
        refusal = f"{what} protects the robot; narrow it with `with_bounds`, or load the robot with wider limits"
        left = self._changed(what, self._less, _can_be_dropped, refusal)
        return replace(left, tracks=tuple(track for track in left.tracks if len(track)))

    def _is_free(self, track: Track) -> bool:
        """Whether the intervals of a track may be set."""
        return True

    def _less(self, track: Track, edges: Bools) -> Track:
        """Return a track without some edges."""
        return track.subset(~edges)

    def _require_known(self, ends: tuple[str, str]) -> None:
        for end in ends:
            if end not in self.ends:
                raise GraphError(f"nothing in the graph is called {end!r}; {known(self.ends)}")

    def _changed(
        self,
        what: str | tuple[str, str],
        change: Callable[[Track, Bools], Track],
        applies: Callable[[Track], bool],
        refusal: str,
    ) -> Self:
        """Return the graph with the named edges changed, in the tracks to which the change applies.

        Raises:
            GraphError: an unknown kind or end, or the change applies to no track.
        """
        if not isinstance(what, str):
            self._require_known(what)
        elif what not in self.kinds:
            raise GraphError(f"no kind {what!r}; {known(self.kinds)}")
        tracks, changed = [], False
        for track in self.tracks:
            edges = np.full(len(track), track.name == what) if isinstance(what, str) else track.joins(*what)
            chosen = bool(edges.any()) and applies(track)
            changed |= chosen
            tracks.append(change(track, edges) if chosen else track)
        if not changed:
            raise GraphError(refusal)
        return replace(self, tracks=tuple(tracks))


def _is_cost(track: Track) -> bool:
    return track.role is Role.COST


def _can_be_dropped(track: Track) -> bool:
    return (track.role, track.stencil) != (Role.BOUND, FRAME)


def _rebounded(track: Track, edges: Bools, lower: float | None, upper: float | None, factor: float) -> Track:
    """Return a track with other intervals of some edges."""
    low, high = (
        factor * (own[:, edges] if bound is None else np.full_like(own[:, edges], bound))
        for own, bound in ((track.lower, lower), (track.upper, upper))
    )
    if (low > high).any() or not np.isfinite(factor):
        raise GraphError(f"{track.name}: the bounds leave no interval: {low.max():g} … {high.min():g}")
    if track.role is Role.BOUND and ((low < track.lower[:, edges]).any() or (high > track.upper[:, edges]).any()):
        raise GraphError(f"{track.name}: bounds can be narrowed only; the robot's limits file widens them")
    return track.bounded(low, high, edges)


def _table_rows(track: Track, frames: np.ndarray) -> np.ndarray:
    """Return the expansion of one track."""
    present = np.argwhere(track.priority[frames] > 0)
    t, edges = frames[present[:, 0]], present[:, 1]
    rows = np.empty(len(present), dtype=ROW)
    rows["kind"], rows["frame"] = track.name, t
    ends = np.array(track.ends).reshape(-1, 2)
    rows["a"], rows["b"] = ends[edges].T
    rows["axis"] = np.array(track.axes)[edges] if track.axes else ""
    for column in ("lower", "upper", "priority"):
        rows[column] = getattr(track, column)[t, edges]
    rows["hard"] = rows["priority"] >= HARD
    return rows
