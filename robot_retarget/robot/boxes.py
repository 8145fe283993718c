"""Places where two boxes are near each other: nearest points and corners, independent of the order of the boxes.

MuJoCo's own contacts of boxes that do not touch yet miss pairs, are off by up to a centimetre, and change when the
boxes are mirrored. Here the nearest two points come from `mj_geomDistance`. One point alone lets boxes roll about it, so
the corners near the other box are added: a point p is ‖max(|p| − h, 0)‖ away from a box of half sizes h. Boxes that overlap
get no corners, because a corner inside a box has no direction out of it.
"""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints

TOUCHING = 1e-9
"""Boxes this near have no direction between them [m]."""
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True, eq=False)
class GeomDistances:
    """C places where geoms are near each other."""

    distance: Floats
    """(C,) [m], negative inside."""
    geoms: Ints
    """(C, 2)."""
    place: Floats
    """(C, 3) half way between the surfaces [m]."""
    normal: Floats
    """(C, 3) from the first geom to the second."""

    def __len__(self) -> int:
        return len(self.distance)

    def __add__(self, other: "GeomDistances") -> "GeomDistances":
        parts = zip(vars(self).values(), vars(other).values(), strict=True)
        return GeomDistances(*(np.concatenate(both) for both in parts))

    def __getitem__(self, rows: Ints) -> "GeomDistances":
        geoms, place, normal = (
            self.geoms.take(rows, axis=0),
            self.place.take(rows, axis=0),
            self.normal.take(rows, axis=0),
        )
        return GeomDistances(self.distance.take(rows), geoms, place, normal)


class Boxes:
    """Pairs of boxes that may collide, and the places at which they are near each other."""

    model: mujoco.MjModel
    pairs: Ints
    reach: float
    boxes: Ints

    def __init__(self, model: mujoco.MjModel, pairs: Ints, reach: float):
        """Watch pairs of box geoms (N, 2) within `reach` [m]."""
        self.model, self.pairs, self.reach = model, pairs, reach
        self.sizes: Floats = np.array(model.geom_size)
        self.boxes, places = np.unique(pairs, return_inverse=True)
        first, second = places.reshape(-1, 2).T
        # Squared distances of centres; those of pairs that are not watched are never less.
        self.balls: Floats = np.full((len(self.boxes), len(self.boxes)), -1.0)
        self.balls[first, second] = (np.asarray(model.geom_rbound)[pairs].sum(axis=1) + reach) ** 2

    def near(self, data: mujoco.MjData) -> GeomDistances:
        """Return the places at which boxes are near each other, at the poses of `data`."""
        pairs, turn, offset = self._candidates(data)
        if not len(pairs):
            return GeomDistances(np.empty(0), pairs, np.empty((0, 3)), np.empty((0, 3)))
        nearest = self._nearest(data, pairs)
        apart = np.flatnonzero(nearest.distance > TOUCHING)
        pairs, turn, offset = pairs[apart], turn[apart], offset[apart]
        return nearest[np.flatnonzero(np.abs(nearest.distance) > TOUCHING)] + self._corners(
            data,
            np.concatenate([pairs, pairs[:, ::-1]]),
            np.concatenate([turn, turn.mT]),
            np.concatenate([offset, -_times(turn.mT, offset)]),
        )

    def _candidates(self, data: mujoco.MjData) -> tuple[Ints, Floats, Floats]:
        """Pairs that no face holds farther apart than the reach; the second box's rotation and centre in the first's axes."""
        centres = data.geom_xpos.take(self.boxes, axis=0)
        squares = (centres * centres).sum(axis=1)
        ends = (squares[:, None] + squares - 2 * centres @ centres.T < self.balls).nonzero()
        one, other = (self.boxes.take(end) for end in ends)
        turns = data.geom_xmat.reshape(-1, 3, 3)
        first, gap = turns.take(one, axis=0).mT, centres.take(ends[1], axis=0) - centres.take(ends[0], axis=0)
        turn, offset = first @ turns.take(other, axis=0), _times(first, gap)
        size, other_size, spread = self.sizes.take(one, axis=0), self.sizes.take(other, axis=0), np.abs(turn)
        apart = np.maximum(
            np.abs(offset) - size - _times(spread, other_size),
            np.abs(_times(turn.mT, offset)) - other_size - _times(spread.mT, size),
        ).max(axis=1)
        keep = (apart < self.reach).nonzero()[0]
        return np.stack([one, other], axis=1).take(keep, axis=0), turn.take(keep, axis=0), offset.take(keep, axis=0)

    def _nearest(self, data: mujoco.MjData, pairs: Ints) -> GeomDistances:
        """The nearest points of every pair; boxes that just touch have no normal."""
        ends, distance = np.zeros((len(pairs), 6)), np.empty(len(pairs))
        for k, (a, b) in enumerate(pairs.tolist()):
            distance[k] = mujoco.mj_geomDistance(self.model, data, a, b, 2 * self.reach, ends[k])
        ends = ends.reshape(-1, 2, 3)
        way = (ends[:, 1] - ends[:, 0]) / np.where(np.abs(distance) > TOUCHING, distance, np.inf)[:, None]
        for k in np.flatnonzero(np.abs(distance) <= TOUCHING):
            distance[k], way[k] = self._between_faces(data, *pairs[k])
        return GeomDistances(distance, pairs, ends.mean(axis=1), way)

    def _between_faces(self, data: mujoco.MjData, first: int, second: int) -> tuple[float, Floats]:
        """Return the largest gap along a face normal of two boxes [m], negative inside, and that normal.

        `mj_geomDistance` is 0 for some boxes whose faces overlap by millimetres.
        """
        axes = data.geom_xmat.reshape(-1, 3, 3)[[first, second]]
        normals, way = np.concatenate([axes[0].T, axes[1].T]), data.geom_xpos[second] - data.geom_xpos[first]
        half = [np.abs(normals @ own) @ self.sizes[box] for own, box in zip(axes, (first, second), strict=True)]
        gap = np.abs(normals @ way) - half[0] - half[1]
        best = int(gap.argmax())
        return float(gap[best]), normals[best] * np.sign(normals[best] @ way)

    def _corners(self, data: mujoco.MjData, pairs: Ints, turn: Floats, offset: Floats) -> GeomDistances:
        """Corners of the second box of each pair near the surface of the first."""
        corner = (_CORNERS * self.sizes[pairs[:, 1], None]) @ turn.mT + offset[:, None]
        out = np.maximum(np.abs(corner) - self.sizes[pairs[:, 0], None], 0.0)
        distance = np.sqrt((out * out).sum(axis=2))
        pair, which = ((distance > TOUCHING) & (distance < self.reach)).nonzero()
        corner, out, distance = corner[pair, which], out[pair, which], distance[pair, which]
        slope = out * np.sign(corner) / distance[:, None]
        box = pairs[pair, 0]
        axes = data.geom_xmat.reshape(-1, 3, 3)[box]
        place = data.geom_xpos[box] + _times(axes, corner - 0.5 * distance[:, None] * slope)
        return GeomDistances(distance, pairs[pair], place, _times(axes, slope))


def _times(matrix: Floats, vector: Floats) -> Floats:
    """(N, 3, 3) · (N, 3)."""
    return (matrix @ vector[..., None])[..., 0]
