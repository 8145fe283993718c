"""The instance of a dynamical distance geometry problem: G = (V × T, E, {δ, π})."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.dgp.interaction import Interaction
from robot_retarget.errors import GraphError, known


class Kind(IntEnum):
    """The label of an edge. `INTERACTION` and `SMOOTHNESS` change its measure; the other kinds do not."""

    BONE = 0
    """Two joints of one rigid part, [MucherinoOmer2019, Definition 3]."""
    POSTURE = 1
    """Two objects of one frame, the E_t of [MucherinoOmer2019, §4.1]."""
    TRACE = 2
    """One object at two times, the E_v of [MucherinoOmer2019, eq. 1]."""
    SEPARATION = 3
    """Two objects kept apart, δ = [Δ, ∞], [MucherinoOmer2019, eq. 2]."""
    INTERACTION = 4
    """Measured by the interaction distance of [Mucherino2019, Definition 12]."""
    SMOOTHNESS = 5
    """Joins v at t − 1 and t + 1 and measures ‖x^(t−1) − 2 x^t + x^(t+1)‖, twice the distance of v_t from their middle.

    An extension of the papers: distances between frames constrain the speed, not the direction.
    """
    TOUCH = 6
    COMPASS = 7
    PATH = 8
    FOOTHOLD = 9
    GROUND = 10


_COLUMNS = ("i", "j", "lower", "upper", "priority", "kind", "huber_delta")
"""The columns of the edges."""


@runtime_checkable
class Animated(Protocol):
    """A motion as input of graphs: positions of named joints in a tree over time."""

    @property
    def skeleton(self) -> Any:
        """A skeleton with `names` (V,) and `parents` (V,), −1 at a root."""
        ...

    @property
    def positions(self) -> Floats:
        """(T, V, K) [m]."""
        ...


@dataclass(frozen=True)
class Graph:
    """G = (V × T, E, {δ, π}) in dimension K, [MucherinoOmer2019, §1]; T = {1} is the ordinary problem.

    The vertex v at frame t has the id t·|V| + v, so a realization x (T, V, K) lists its rows in id order. The target of
    an edge is a distance within [lower, upper]; equal bounds are an exact δ. Scalars apply to every edge or vertex, so
    `dataclasses.replace(graph, priority=1.0)` is enough.

    Raises:
        GraphError: contradictory bounds, a NaN, an unknown vertex or a loop; the message names the edge.
    """

    vertices: tuple[str, ...]
    """V, the names of the objects."""
    frames: int
    """|T|."""
    dimension: int
    """K, 2 or 3."""
    i: Ints
    """(E,) id of one end."""
    j: Ints
    """(E,) id of the other end."""
    lower: Floats
    """(E,) least distance [m]."""
    upper: Floats
    """(E,) greatest distance [m], ∞ for no bound."""
    priority: Floats = field(default_factory=lambda: np.array(1.0))
    """(E,) π ≥ 0, the importance of the edge."""
    kind: NDArray[np.int8] = field(default_factory=lambda: np.array(Kind.POSTURE, np.int8))
    """(E,) of `Kind`."""
    huber_delta: Floats = field(default_factory=lambda: np.array(np.inf))
    """(E,) Huber scale g > 0 [m]: errors well above it count linearly under the squared objectives; ∞ counts
    squares."""
    fixed: NDArray[np.bool_] = field(default_factory=lambda: np.array(False))
    """(T, V) the vertices that stay at their start."""
    box_lower: Floats = field(default_factory=lambda: np.array(-np.inf))
    """(T, V, K) least coordinates [m]."""
    box_upper: Floats = field(default_factory=lambda: np.array(np.inf))
    """(T, V, K) greatest coordinates [m]."""
    interaction: Interaction = field(default_factory=Interaction)
    """The measure of edges of kind `INTERACTION`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", tuple(self.vertices))
        if not self.vertices or self.frames < 1 or self.dimension not in (2, 3):
            raise GraphError(
                f"a graph needs vertices, frames ≥ 1 and dimension 2 or 3; got {len(self.vertices)} vertices, "
                f"{self.frames} frames, dimension {self.dimension}"
            )
        if len(set(self.vertices)) < len(self.vertices):
            twice = next(name for name in self.vertices if self.vertices.count(name) > 1)
            raise GraphError(f"vertex {twice!r} is listed twice")
        edges, places = np.shape(self.i), (self.frames, len(self.vertices))
        if len(edges) != 1:
            raise GraphError(f"edge ends must be one-dimensional, got shape {edges}")
        self._spread(("i", "j"), edges, np.int64)
        self._spread(("lower", "upper", "priority", "huber_delta"), edges, np.float64)
        self._spread(("kind",), edges, np.int8)
        self._spread(("fixed",), places, np.bool_)
        self._spread(("box_lower", "box_upper"), (*places, self.dimension), np.float64)
        self._check_ends()
        self._check_bounds()

    def _spread(self, names: tuple[str, ...], shape: tuple[int, ...], dtype: Any) -> None:
        for name in names:
            values = np.asarray(getattr(self, name))
            try:
                object.__setattr__(self, name, frozen(np.broadcast_to(values, shape), dtype))
            except ValueError:
                raise GraphError(f"{name} must be a scalar or {shape}, got {values.shape}") from None

    def _check_ends(self) -> None:
        ends = np.stack([self.i, self.j])
        outside = np.flatnonzero(((ends < 0) | (ends >= self.frames * len(self.vertices))).any(axis=0))
        if outside.size:
            edge = outside[0]
            raise GraphError(
                f"edge {edge} joins ids {self.i[edge]} and {self.j[edge]}, but the graph has "
                f"{len(self.vertices)} vertices × {self.frames} frames; {known(self.vertices)}"
            )
        self._refuse(self.i == self.j, "joins a vertex to itself")
        moving = self.kind == Kind.INTERACTION
        same = self.i // len(self.vertices) == self.j // len(self.vertices)
        self._refuse(moving & ~same, "is an interaction across two frames; both ends belong to one")
        first = np.minimum(self.i, self.j) < len(self.vertices)
        self._refuse(moving & first, "is an interaction in the first frame, which has no previous one")
        apart = np.abs(self.i - self.j) != 2 * len(self.vertices)
        self._refuse((self.kind == Kind.SMOOTHNESS) & apart, "is smoothness but does not join v_(t−1) and v_(t+1)")

    def _check_bounds(self) -> None:
        for name in ("lower", "upper", "priority", "huber_delta"):
            self._refuse(np.isnan(getattr(self, name)), f"has {name} NaN")
        self._refuse(self.lower < 0, "has a negative lower bound")
        self._refuse(np.isinf(self.lower), "has an infinite lower bound")
        self._refuse(self.lower > self.upper, "has lower > upper")
        self._refuse(self.huber_delta <= 0, "has a Huber scale that is not above 0")
        self._refuse((self.priority < 0) | np.isinf(self.priority), "has a priority outside [0, ∞)")
        crossed = np.argwhere(~(self.box_lower <= self.box_upper))
        if crossed.size:
            frame, vertex, axis = crossed[0]
            raise GraphError(f"vertex {self.vertices[vertex]}@{frame} has an empty box on axis {axis}")

    def _refuse(self, wrong: NDArray[np.bool_], what: str) -> None:
        if wrong.any():
            edge = int(np.flatnonzero(wrong)[0])
            values = f"lower {self.lower[edge]:g}, upper {self.upper[edge]:g}, priority {self.priority[edge]:g}"
            raise GraphError(f"edge {edge} ({self.edge_name(edge)}) {what}: {values}")

    @classmethod
    def of(
        cls,
        motion: "Animated | ArrayLike",
        names: Sequence[str] | None = None,
        *,
        postures: bool = True,
        traces: int = 3,
        fixed: Sequence[str] = (),
    ) -> "Graph":
        """Return E* of a motion: exact edges δ = d(x) whose realization of zero stress is the motion itself.

        Args:
            motion: a motion with a skeleton, whose bones are edges of kind `BONE`; or positions (T, V, K) of objects
                [m].
            names: names of the objects; by default those of the motion, or numbers.
            postures: add every pair of every frame, ⋃ E_t; omit them if objects move independently, as in a crowd.
            traces: number of past positions joined to every object, ⋃ E_v with τ; 0 omits them.
            fixed: objects that do not move, such as obstacles.

        Raises:
            GraphError: positions of another shape or not finite, or an unknown object.
            UsageError: fewer frames than traces need.
        """
        from robot_retarget.dgp.build import motion_edges  # imported here: what builds graphs stands over them

        graph = motion_edges(motion, names, postures, traces)
        held = [graph.vertex(name) % len(graph.vertices) for name in fixed]
        return replace(graph, fixed=np.isin(np.arange(len(graph.vertices)), held))

    def __len__(self) -> int:
        """|E|."""
        return len(self.i)

    def vertex(self, name: str, frame: int = 0) -> int:
        """Return the id of an object at a frame.

        Raises:
            GraphError: the object or the frame is unknown.
        """
        if name not in self.vertices:
            raise GraphError(f"unknown vertex {name!r}; {known(self.vertices)}")
        if not 0 <= frame < self.frames:
            raise GraphError(f"vertex {name!r} has no frame {frame}; frames 0 … {self.frames - 1}")
        return frame * len(self.vertices) + self.vertices.index(name)

    def vertex_name(self, vertex: int) -> str:
        """Return `name@frame` of an id; the bare name in a graph of one frame."""
        frame, place = divmod(int(vertex), len(self.vertices))
        return self.vertices[place] if self.frames == 1 else f"{self.vertices[place]}@{frame}"

    def edge_name(self, edge: int) -> str:
        """Return both ends of an edge: `wrist@3–head@3`."""
        return f"{self.vertex_name(self.i[edge])}–{self.vertex_name(self.j[edge])}"

    @property
    def exact(self) -> NDArray[np.bool_]:
        """(E,) where lower = upper."""
        return self.lower == self.upper

    def select(self, edges: ArrayLike) -> "Graph":
        """The same vertices with some of the edges: a mask or indices over E."""
        chosen = np.asarray(edges)
        return replace(self, **{name: getattr(self, name)[chosen] for name in _COLUMNS})

    def joined(self, *others: "Graph") -> "Graph":
        """E* ∪ E⁺: the edges of several graphs over the same V × T; boxes and fixed vertices are this graph's.

        Raises:
            GraphError: the vertices, frames or dimensions differ.
        """
        for other in others:
            if (other.vertices, other.frames, other.dimension) != (self.vertices, self.frames, self.dimension):
                raise GraphError(
                    f"cannot join graphs over different V × T: {len(self.vertices)} × {self.frames} in dimension "
                    f"{self.dimension} and {len(other.vertices)} × {other.frames} in dimension {other.dimension}"
                )
        graphs = (self, *others)
        return replace(self, **{name: np.concatenate([getattr(graph, name) for graph in graphs]) for name in _COLUMNS})

    def induced(self, vertices: ArrayLike, first: int, last: int) -> "Graph":
        """G[vertices × {first … last}], the edges with both ends inside, [MucherinoOmer2019, §2].

        An interaction edge also needs its previous frame inside.
        """
        places = np.atleast_1d(np.asarray(vertices, dtype=np.int64))
        if not 0 <= first <= last < self.frames:
            raise GraphError(f"frames {first} … {last} are not within 0 … {self.frames - 1}")
        new = np.full((self.frames, len(self.vertices)), -1)
        new[first : last + 1, places] = np.arange((last - first + 1) * len(places)).reshape(-1, len(places))
        ids = new.ravel()
        kept = (ids[self.i] >= 0) & (ids[self.j] >= 0)
        kept &= (self.kind != Kind.INTERACTION) | (self.i >= (first + 1) * len(self.vertices))
        window = {name: getattr(self, name)[first : last + 1, places] for name in ("fixed", "box_lower", "box_upper")}
        return replace(
            self,
            vertices=tuple(self.vertices[place] for place in places),
            frames=last - first + 1,
            **{name: getattr(self, name)[kept] for name in _COLUMNS} | {"i": ids[self.i[kept]], "j": ids[self.j[kept]]},
            **window,
        )

    def at_frame(self, frame: int) -> "Graph":
        """G_t, one posture of the animation."""
        return self.induced(np.arange(len(self.vertices)), frame, frame)

    def of_vertex(self, name: str, first: int = 0, last: int | None = None) -> "Graph":
        """G_v^(first, last), one object's trajectory."""
        place = self.vertex(name) % len(self.vertices)
        return self.induced([place], first, self.frames - 1 if last is None else last)

    def checked(self, realization: ArrayLike) -> Floats:
        """A realization as (T, V, K); a single frame may leave T out.

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
