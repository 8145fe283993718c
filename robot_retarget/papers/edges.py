"""The expansion of tracks over V × T: the table of the papers, one row for every edge at every frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from robot_retarget.base.arrays import Floats, Ints
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
