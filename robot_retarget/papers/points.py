"""The graph of free points: the papers' problem, whose realization is x: V × T → ℝ^K."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.base.arrays import Bools, Floats, frozen
from robot_retarget.base.errors import GraphError, known
from robot_retarget.graph.added import OwnKind
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.graph import Graph
from robot_retarget.graph.interaction import Interaction
from robot_retarget.graph.track import FRAME, HARD, Track, exact, merged
from robot_retarget.papers.edges import BONE, Edges, expand


@dataclass(frozen=True, eq=False)
class PointGraph(Graph):
    """G = (V × T, E, {δ, π}) in dimension K, [MucherinoOmer2019, §1]; T = {1} is the ordinary problem.

    The target of an edge is a distance within [lower, upper]; equal bounds are an exact δ.

    Raises:
        GraphError: contradictory bounds, a NaN, an unknown vertex or a loop; the message names the edge.
    """

    vertices: tuple[str, ...]
    """V, the names of the objects."""
    frames: int
    """|T|."""
    dimension: int
    """K, 2 or 3."""
    fixed: NDArray[np.bool_] = field(default_factory=lambda: np.array(False))
    """(T, V) the vertices that stay at their start; broadcast."""
    box_lower: Floats = field(default_factory=lambda: np.array(-np.inf))
    box_upper: Floats = field(default_factory=lambda: np.array(np.inf))
    """(T, V, K) bounds of the coordinates [m]; broadcast."""
    interaction: Interaction = field(default_factory=Interaction)
    """The measure of edges of kind `INTERACTION`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", tuple(self.vertices))
        object.__setattr__(self, "tracks", tuple(self.tracks))
        if not self.vertices or self.frames < 1 or self.dimension not in (2, 3):
            raise GraphError(
                f"a graph needs vertices, frames ≥ 1 and dimension 2 or 3; got {len(self.vertices)} vertices, "
                f"{self.frames} frames, dimension {self.dimension}"
            )
        if len(set(self.vertices)) < len(self.vertices):
            twice = next(name for name in self.vertices if self.vertices.count(name) > 1)
            raise GraphError(f"vertex {twice!r} is listed twice")
        places = (self.frames, len(self.vertices))
        self._spread(("fixed",), places, np.bool_)
        self._spread(("box_lower", "box_upper"), (*places, self.dimension), np.float64)
        for track in self.tracks:
            self._check(track)
        crossed = np.argwhere(~(self.box_lower <= self.box_upper))
        if crossed.size:
            frame, vertex, axis = crossed[0]
            raise GraphError(f"vertex {self.vertices[vertex]}@{frame} has an empty box on axis {axis}")

    def _spread(self, names: tuple[str, ...], shape: tuple[int, ...], dtype: Any) -> None:
        for name in names:
            values = np.asarray(getattr(self, name))
            try:
                object.__setattr__(self, name, frozen(np.broadcast_to(values, shape), dtype))
            except ValueError:
                raise GraphError(f"{name} must be a scalar or {shape}, got {values.shape}") from None

    def _check(self, track: Track) -> None:
        if len(track.lower) != self.frames:
            raise GraphError(f"{track.name} has {len(track.lower)} frames, the graph {self.frames}")
        unknown = {end for pair in track.ends for end in pair} - set(self.vertices)
        if unknown:
            raise GraphError(f"unknown vertex {min(unknown)!r}; {known(self.vertices)}")
        loop = np.array([track.stencil == FRAME and a == b for a, b in track.ends], dtype=bool)
        track.refuse(np.broadcast_to(loop, track.lower.shape), "joins a vertex to itself")
        track.refuse((track.lower < 0) | np.isinf(track.lower), "has a lower bound that is negative or infinite")
        track.refuse(np.isinf(track.priority), "has an infinite priority")

    def __len__(self) -> int:
        """|T|."""
        return self.frames

    def __repr__(self) -> str:
        counts = ", ".join(f"{track.present.sum()} {track.name}" for track in self.tracks)
        size = f"{len(self.vertices)} vertices × {self.frames} frames in {self.dimension} dimensions"
        return f"<PointGraph of {size}; edges: {counts or 'none'}>"

    @cached_property
    def edges(self) -> Edges:
        """E, one by one: `edges[k]`, `for edge in edges`, or its columns."""
        return expand(self.tracks, self.vertices, self.frames)

    def place(self, name: str) -> int:
        """Return the index of an object in V.

        Raises:
            GraphError: the object is unknown.
        """
        if name not in self.vertices:
            raise GraphError(f"unknown vertex {name!r}; {known(self.vertices)}")
        return self.vertices.index(name)

    def select(self, edges: Bools) -> "PointGraph":
        """Return the same vertices with some of the edges: a mask over `edges`."""
        return self._distributed(lambda track, chosen: _kept(track, chosen), edges)

    def with_targets(self, **columns: ArrayLike) -> "PointGraph":
        """Return the graph with other values of some columns of `edges`: lower, upper or priority.

        Args:
            columns: (E,) or a scalar each; the edges of a kind with a scale keep it.
        """
        spread = [np.broadcast_to(np.asarray(values, dtype=np.float64), len(self.edges)) for values in columns.values()]
        return self._distributed(lambda track, values: _revalued(track, tuple(columns), values), np.stack(spread, -1))

    def _distributed(self, change: Any, values: np.ndarray) -> "PointGraph":
        """Return the graph with every track changed by its own part of values (E, …)."""
        sizes = [int(track.present.sum()) for track in self.tracks]
        parts = np.split(values, np.cumsum(sizes)[:-1]) if sizes else []
        tracks = [change(track, part) for track, part in zip(self.tracks, parts, strict=True)]
        return replace(self, tracks=tuple(track for track in tracks if len(track)))

    def joined(self, *others: "PointGraph") -> "PointGraph":
        """Return E* ∪ E⁺: the edges of several graphs over the same V × T; boxes and fixed vertices are this graph's.

        Raises:
            GraphError: the vertices, frames or dimensions differ, or two kinds of one name.
        """
        tracks = self.kinds
        for other in others:
            if (other.vertices, other.frames, other.dimension) != (self.vertices, self.frames, self.dimension):
                raise GraphError(
                    f"cannot join graphs over different V × T: {len(self.vertices)} × {self.frames} in dimension "
                    f"{self.dimension} and {len(other.vertices)} × {other.frames} in dimension {other.dimension}"
                )
            for name, track in other.kinds.items():
                tracks[name] = merged(tracks[name], track) if name in tracks else track
        return replace(self, tracks=tuple(tracks.values()))

    def induced(self, vertices: ArrayLike, first: int, last: int) -> "PointGraph":
        """Return G[vertices × {first … last}], the edges with all their frames and both ends inside, [MucherinoOmer2019, §2].

        Args:
            vertices: indices in V.
            last: last frame, included.

        Raises:
            GraphError: the frames are not of the graph.
        """
        places = np.atleast_1d(np.asarray(vertices, dtype=np.int64))
        if not 0 <= first <= last < self.frames:
            raise GraphError(f"frames {first} … {last} are not within 0 … {self.frames - 1}")
        names, frames = tuple(self.vertices[place] for place in places), slice(first, last + 1)
        inside = [np.array([set(pair) <= set(names) for pair in track.ends], dtype=bool) for track in self.tracks]
        tracks = (track.subset(kept).at(frames) for track, kept in zip(self.tracks, inside, strict=True) if kept.any())
        window = {name: getattr(self, name)[frames, places] for name in ("fixed", "box_lower", "box_upper")}
        return replace(self, tracks=tuple(tracks), vertices=names, frames=last - first + 1, **window)

    def at_frame(self, frame: int) -> "PointGraph":
        """Return G_t, one posture of the animation."""
        return self.induced(np.arange(len(self.vertices)), frame, frame)

    def checked(self, realization: ArrayLike) -> Floats:
        """Return a realization as (T, V, K); a single frame may omit T.

        Raises:
            GraphError: its shape is not V × T in dimension K, or a coordinate is not finite (the vertex is named).
        """
        x = np.array(realization, dtype=np.float64)
        expected = (self.frames, len(self.vertices), self.dimension)
        if x.ndim and x.shape[-1] != self.dimension:
            raise GraphError(f"the realization has K = {x.shape[-1]}, the graph K = {self.dimension}")
        if x.shape == expected[1:] and self.frames == 1:
            x = x[None]
        if x.shape != expected:
            raise GraphError(f"the realization must be {expected} (frames, vertices, K), got {x.shape}")
        lost = np.argwhere(~np.isfinite(x))
        if lost.size:
            raise GraphError(f"vertex {self.vertices[lost[0][1]]}@{lost[0][0]} has a coordinate that is not finite")
        return x


def _kept(track: Track, chosen: Bools) -> Track:
    """Return a track with the chosen ones of its present edges."""
    present = track.present.copy()
    present[present] = chosen
    kept = np.flatnonzero(present.any(axis=0))
    return replace(track.subset(kept), priority=np.where(present, track.priority, 0.0)[:, kept])


def _revalued(track: Track, names: tuple[str, ...], values: Floats) -> Track:
    """Return a track with columns of its present edges set to values (E, columns)."""
    columns = {name: np.array(getattr(track, name)) for name in names}
    for column, value in zip(columns.values(), values.T, strict=True):
        column[track.present] = value
    if "priority" in columns:
        columns["priority"] *= track.scale**2
    return replace(track, **columns)


# The graph of a retargeting as the papers' graph of free points: vertices v_t that no robot joins.
#
# An edge that measures the distance of two keypoints, or of a keypoint and a place, becomes one edge per frame with the
# same interval, π over the square of its scale and its Huber scale in metres, so that its stress is the same to rounding:
#
#     π ϱ_g((d − y)/s) = (π/s²) ϱ_(g s)(d − y).
#
# Properties that the robot keeps by construction become edges: its bones, exact and hard. The expansion omits edges that
# are not distances of two free points: directions and places along an axis (compass, orientation, path, foothold, mass:
# limits of distances to far beacons), angles (rest), second differences of joints, points that a body carries, and the
# limits of the robot.


def expanded(graph: RobotGraph) -> PointGraph:
    """Return the graph of points over V × T: V the keypoints, and the places of added edges, fixed by their boxes."""
    places = places_of(graph)
    vertices = (*graph.match.keypoints, *places)
    tracks = [track.subset(between_points(track, vertices)) for track in graph.costs]
    held = np.array([places.get(name, np.full(3, np.nan)) for name in vertices])
    below, above = (np.where(np.isnan(held), free, held) for free in (-np.inf, np.inf))
    chosen = (_bones(graph), *(track for track in tracks if len(track)))
    return PointGraph(chosen, vertices, len(graph), 3, box_lower=below, box_upper=above)


def places_of(graph: RobotGraph) -> dict[str, Floats]:
    """Return the places in the world at which added edges end, by name."""
    found = {}
    for track in graph.tracks:
        if isinstance(track.kind, OwnKind):
            for ends, names in zip(track.kind.ends, track.ends, strict=True):
                found |= {n: e for e, n in zip(ends, names, strict=True) if isinstance(e, np.ndarray)}
    return found


def between_points(track: Track, vertices: Collection[str]) -> np.ndarray:
    """Return (E,) which edges measure the distance of two vertices.

    Args:
        track: E edges of the kind over T frames.
        vertices: names of points.
    """
    return np.array([not track.axes and set(ends) <= set(vertices) for ends in track.ends], dtype=bool)


def _bones(graph: RobotGraph) -> Track:
    """Return the robot's bones with their lengths in its reference pose."""
    match, leg = graph.match, graph.match.robot_leg
    children = np.flatnonzero((match.parents >= 0) & (match.robot_bones > 0))
    ends = tuple((match.keypoints[match.parents[child]], match.keypoints[child]) for child in children)
    length = np.broadcast_to(match.robot_bones[children], (len(graph), len(ends)))
    return exact(BONE, ends, length, HARD, leg)
