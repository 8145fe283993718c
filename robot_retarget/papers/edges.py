"""The expansion of tracks over V × T: the table of the papers, one row for every edge at every frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.interaction import Interaction, steps_ahead
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.track import FRAME, SECOND_DIFFERENCE, STEP, Role, Track


class Distance(IntEnum):
    """The measure of an edge between points."""

    EUCLIDEAN = 0
    INTERACTION = 1
    """The interaction distance of [Mucherino2019, Definition 12]."""
    SECOND_DIFFERENCE = 2
    """‖x^(t−1) − 2 x^t + x^(t+1)‖ of one object, twice the distance of v_t from the middle of its neighbours."""


@dataclass(frozen=True)
class PointKind(Kind):
    """A kind of edge between points."""

    name: str
    distance: Distance = Distance.EUCLIDEAN
    stencil: tuple[int, ...] = FRAME
    role: Role = Role.COST


BONE = PointKind("bone")
"""Two joints of one rigid part, [MucherinoOmer2019, Definition 3]."""
POSTURE = PointKind("posture")
"""Two objects of one frame, the E_t of [MucherinoOmer2019, §4.1]."""
SEPARATION = PointKind("separation")
"""Two objects kept apart, δ = [Δ, ∞], [MucherinoOmer2019, eq. 2]."""
INTERACTION = PointKind("interaction", Distance.INTERACTION, STEP)
"""Two objects by their interaction distance."""
SMOOTHNESS = PointKind("smoothness", Distance.SECOND_DIFFERENCE, SECOND_DIFFERENCE)
"""One object in three frames: distances between frames constrain its speed, not its direction."""


def trace(lag: int) -> PointKind:
    """Return the kind of one object at two times, `lag` frames apart: the E_v of [MucherinoOmer2019, eq. 1]."""
    return PointKind(f"trace {lag}", stencil=(-lag, 0))


class Edge(NamedTuple):
    """One edge."""

    a: str
    b: str
    """Its ends, as `name@frame`."""
    lower: float
    upper: float
    """The target interval [m]."""
    priority: float
    """π [1/m²]."""
    kind: str


@dataclass(frozen=True, eq=False)
class Edges:
    """E edges over V × T: track after track, frame after frame. The vertex v at frame t has the id t·|V| + v."""

    vertices: tuple[str, ...]
    frames: int
    i: Ints
    j: Ints
    """(E,) ids of both ends."""
    lower: Floats
    upper: Floats
    """(E,) the target interval [m]."""
    priority: Floats
    """(E,) π [1/m²]."""
    huber_delta: Floats
    """(E,) Huber scale [m]; ∞ counts squares."""
    kind: NDArray[np.str_]
    """(E,) names of kinds."""
    distance: Ints
    """(E,) of `Distance`."""

    def __len__(self) -> int:
        return len(self.i)

    def __getitem__(self, k: int) -> Edge:
        """Return an edge."""
        lower, upper, priority = (float(column[k]) for column in (self.lower, self.upper, self.priority))
        return Edge(self.vertex_name(self.i[k]), self.vertex_name(self.j[k]), lower, upper, priority, str(self.kind[k]))

    def __iter__(self) -> Iterator[Edge]:
        return map(self.__getitem__, range(len(self)))

    def __repr__(self) -> str:
        return f"<{len(self)} edges over {len(self.vertices)} vertices × {self.frames} frames>"

    @property
    def exact(self) -> NDArray[np.bool_]:
        """(E,) where lower = upper."""
        return self.lower == self.upper

    def vertex_name(self, vertex: int) -> str:
        """Return `name@frame` of an id; the bare name in a graph of one frame."""
        frame, place = divmod(int(vertex), len(self.vertices))
        return self.vertices[place] if self.frames == 1 else f"{self.vertices[place]}@{frame}"

    def name(self, edge: int) -> str:
        """Return both ends of an edge: `wrist@3–head@3`."""
        return f"{self.vertex_name(self.i[edge])}–{self.vertex_name(self.j[edge])}"


def expand(tracks: Sequence[Track], vertices: tuple[str, ...], frames: int) -> Edges:
    """Return the edges of tracks one by one; an edge is absent where π = 0 or its stencil leaves the frames.

    An error over a scale s becomes one in metres of the same stress:  π ϱ_g((d − y)/s) = (π/s²) ϱ_(g s)(d − y).

    Args:
        tracks: distances of points over all frames.
        vertices: V, names that hold every end.
        frames: |T|.
    """
    rows = [_rows(track, {name: k for k, name in enumerate(vertices)}) for track in tracks]
    joined = [np.concatenate(column) for column in zip(_NO_ROWS, *rows, strict=True)]
    for column in joined:
        column.setflags(write=False)
    return Edges(vertices, frames, *joined)


_NO_ROWS = (*(np.zeros(0, np.int64),) * 2, *(np.zeros(0),) * 4, np.zeros(0, "U1"), np.zeros(0, np.int64))


def _rows(track: Track, places: dict[str, int]) -> tuple[np.ndarray, ...]:
    frame, edge = np.nonzero(track.present)
    distance = distance_of(track)
    first, last = (0, 0) if distance is Distance.INTERACTION else (track.stencil[0], track.stencil[-1])
    ends = np.array([[places[end] for end in pair] for pair in track.ends]).reshape(-1, 2)[edge]
    return (
        (frame + first) * len(places) + ends[:, 0],
        (frame + last) * len(places) + ends[:, 1],
        track.lower[frame, edge],
        track.upper[frame, edge],
        (track.priority / track.scale**2)[frame, edge],
        (track.huber_delta * track.scale)[edge],
        np.full(len(edge), track.name),
        np.full(len(edge), int(distance)),
    )


def distance_of(track: Track) -> Distance:
    """Return the measure of a track between points: Euclidean unless its kind says otherwise."""
    return track.kind.distance if isinstance(track.kind, PointKind) else Distance.EUCLIDEAN


# From coordinates to the difference vector of every edge, and back: the linear part of every stress.

_DENSE = 20_000
"""Up to this many entries a dense product beats the overhead of a sparse one."""


@dataclass(frozen=True)
class Incidence:
    """r = A x + k ∘ (S x): A takes one end of each edge from the other, S the relative step of an interaction edge.

    k is 0 on Euclidean edges and the steps ahead of `interaction.steps_ahead` on the others, where it follows x.
    """

    ends: Any
    """A, (E, N) dense or sparse."""
    ends_t: Any
    steps: Any
    """S, (E, N) sparse, or None where every edge is Euclidean."""
    steps_t: Any
    interaction: Interaction

    def differences(self, x: Floats) -> tuple[Floats, Floats | None]:
        """Return r (E, K, B) of x (N, K, B) [m], and k (E, B)."""
        flat = x.reshape(len(x), -1)
        r = (self.ends @ flat).reshape(-1, *x.shape[1:])
        if self.steps is None:
            return r, None
        w = (self.steps @ flat).reshape(r.shape)
        k = steps_ahead((r * w).sum(1), (w * w).sum(1), self.interaction)
        return r + k[:, None] * w, k

    def gather(self, forces: Floats, k: Floats | None) -> Floats:
        """Return Aᵀ f + Sᵀ (k ∘ f), (N, K, B): the sums of the edges' pulls f (E, K, B) at each vertex.

        Args:
            forces: f (E, K, B).
            k: (E, B) steps ahead, None where every edge is Euclidean.
        """
        flat = forces.reshape(len(forces), -1)
        total = self.ends_t @ flat
        if k is not None:
            total = total + self.steps_t @ (k[:, None] * forces).reshape(flat.shape)
        return total.reshape(-1, *forces.shape[1:])

    def members(self, edges: Edges, k: Floats | None) -> tuple[Ints, Floats]:
        """Return the vertices (E, m) of each difference and their coefficients (E, m), at constant k.

        Args:
            edges: E edges.
            k: (E, 1) steps ahead, None where every edge is Euclidean.
        """
        ids, coefficients = _members(edges)
        if k is None:
            return ids, coefficients
        earlier = np.where((edges.distance == Distance.INTERACTION)[:, None], ids - len(edges.vertices), ids)
        return np.concatenate([ids, earlier], axis=1), np.concatenate([coefficients * (1 + k), -coefficients * k], 1)


def incidence(edges: Edges, interaction: Interaction) -> Incidence:
    """Return the operator of E edges.

    Args:
        edges: E edges over V × T.
        interaction: the measure of interaction edges.
    """
    shape = len(edges), edges.frames * len(edges.vertices)
    ids, coefficients = _members(edges)
    ends = _matrix(ids, coefficients, shape)
    moving = (edges.distance == Distance.INTERACTION)[:, None] * coefficients
    back = np.where(moving != 0, ids - len(edges.vertices), ids)
    steps = _matrix(ids, moving, shape) - _matrix(back, moving, shape) if moving.any() else None
    if shape[0] * shape[1] <= _DENSE:
        ends = ends.toarray()
    return Incidence(
        ends=ends,
        ends_t=_turned(ends),
        steps=steps,
        steps_t=None if steps is None else steps.T.tocsr(),
        interaction=interaction,
    )


def _members(edges: Edges) -> tuple[Ints, Floats]:
    """Return the terms of x_j − x_i, or of x_j + x_i − 2 x_middle for edges of smoothness."""
    smooth = (edges.distance == Distance.SECOND_DIFFERENCE)[:, None]
    if not smooth.any():
        return np.stack([edges.j, edges.i], axis=1), np.tile([1.0, -1.0], (len(edges), 1))
    middle = np.where(smooth[:, 0], (edges.i + edges.j) // 2, edges.i)
    return np.stack([edges.j, edges.i, middle], axis=1), np.where(smooth, [1.0, 1.0, -2.0], [1.0, -1.0, 0.0])


def _matrix(ids: Ints, coefficients: Floats, shape: tuple[int, int]) -> Any:
    from scipy import sparse  # imported here so that importing the package stays fast

    row = np.repeat(np.arange(shape[0]), ids.shape[1])
    return sparse.csr_array((coefficients.ravel(), (row, ids.ravel())), shape=shape)


def _turned(matrix: Any) -> Any:
    return np.ascontiguousarray(matrix.T) if isinstance(matrix, np.ndarray) else matrix.T.tocsr()
