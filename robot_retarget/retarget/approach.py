"""The interaction distance [Mucherino2019, §4] of surfaces: how close two links come if both keep their last step.

A link is a set of capsules whose ends p move by s = p^t − p^(t−1) in one step, so that after k more steps they stand at
p + k s. At k = 0 the points of two segments that are nearest to each other have the separation c and the relative step
w; the closed form of `dgp.interaction` gives the k at which *these points* are nearest. There the segments have other
nearest points, for which the closed form is asked again. Every round lowers the distance; with r the radii,

    D = ‖c + k w‖ − r_u − r_v,    α = 1 + k,    D ≤ distance now.

Arrays run over (coordinate, capsule pair, frame), so that every operation walks through memory in order.
"""

from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.dgp.interaction import Interaction, steps_ahead
from robot_retarget.robot.capsules import Capsules
from robot_retarget.robot.collidable import Pairs

REST = Interaction(horizon=0)
"""Looks at no step ahead: D is the distance now."""
BLOCK = 32
"""Frames handled at once: the working arrays stay in the processor's cache."""
_POINT = 1e-12
"""Squared lengths below this are those of points [m²]."""


@dataclass(frozen=True)
class Approach:
    """T frames, P pairs of links."""

    distance: Floats
    """(T, P) between the surfaces of the capsules now [m], negative inside."""
    ahead: Floats
    """(T, P) the interaction distance D [m]: the same at its least within the horizon."""
    alpha: Ints
    """(T, P) α: D is reached α − 1 steps from now."""

    def at(self, frames: Ints) -> "Approach":
        """Those of some frames."""
        return Approach(self.distance[frames], self.ahead[frames], self.alpha[frames])


class CapsulePairs:
    """The capsules of every pair of links, pair by pair."""

    def __init__(self, capsules: Capsules, pairs: Pairs):
        tables = [_products(capsules.by_link[a], capsules.by_link[b]) for a, b in pairs.links.tolist()]
        self.count = len(pairs)
        self.first, self.second = np.concatenate(tables, axis=1) if tables else np.zeros((2, 0), int)
        self.starts = np.cumsum([0] + [table.shape[1] for table in tables[:-1]]) if tables else np.zeros(0, int)
        self.owner = np.repeat(np.arange(self.count), [table.shape[1] for table in tables])
        self.single = len(self.owner) == self.count
        self.radii = (capsules.radius[self.first] + capsules.radius[self.second])[:, None]

    def approach(self, ends: Floats, steps: Floats, options: Interaction) -> Approach:
        """D and α of every pair from the ends (T, C, 2, 3) of the capsules and their last steps, the same shape [m]."""
        frames = len(ends)
        shape = (frames, self.count)
        found = Approach(np.empty(shape), np.empty(shape), np.empty(shape, dtype=np.int64))
        for start in range(0, frames, BLOCK):
            block = slice(start, start + BLOCK)
            distance, ahead, k = self._block(ends[block], steps[block], options)
            found.distance[block], found.ahead[block] = distance.T, ahead.T
            found.alpha[block] = 1 + k.T
        return found

    def _block(self, ends: Floats, steps: Floats, options: Interaction) -> tuple[Floats, Floats, Floats]:
        """Distance, D and k, each (P, frames)."""
        both = np.concatenate([ends, steps], axis=-1).transpose(3, 1, 2, 0)
        rows = np.ascontiguousarray(np.concatenate([both[:, :, 0], both[:, :, 1] - both[:, :, 0]]))
        first, second = rows.take(self.first, axis=1), rows.take(self.second, axis=1)
        gap = second[:6] - first[:6]
        now = _Rods(gap[:3], first[6:9], second[6:9])
        step = _Rods(gap[3:], first[9:], second[9:])
        s, t = now.nearest()
        c, w = now.between(s, t), step.between(s, t)
        square = _dot(w, w)
        k = steps_ahead(_dot(c, w), square, options)
        near = _squared(c, w, k)
        there = now.moved(step, k)
        s, t = there.nearest()
        later, w = there.between(s, t), step.between(s, t)
        k2 = np.clip(k + _signed(later, w, options), 0.0, np.floor(options.farthest))
        again = _squared(later, w, k2 - k)
        better = again < near
        distance = np.sqrt(_dot(c, c)) - self.radii
        ahead = np.sqrt(np.where(better, again, near)) - self.radii
        return self._least(distance, ahead, np.where(better, k2, k))

    def _least(self, distance: Floats, ahead: Floats, k: Floats) -> tuple[Floats, Floats, Floats]:
        """From capsule pairs to pairs of links: the nearest now, and the nearest ahead with its k."""
        if self.single or not self.count:
            return distance, ahead, k
        least = np.minimum.reduceat(ahead, self.starts)
        at = np.maximum.reduceat(np.where(ahead <= least[self.owner], k, 0.0), self.starts)
        return np.minimum.reduceat(distance, self.starts), least, at


@dataclass(frozen=True, eq=False)
class _Rods:
    """Pairs of segments: from the one base to the other, and along each; (3, N, frames)."""

    gap: Floats
    u: Floats
    v: Floats

    def moved(self, step: "_Rods", k: Floats) -> "_Rods":
        """The same k steps later."""
        return _Rods(self.gap + k * step.gap, self.u + k * step.u, self.v + k * step.v)

    def between(self, s: Floats, t: Floats) -> Floats:
        """From the point at s on the first to the point at t on the second."""
        return self.gap + t * self.v - s * self.u

    def nearest(self) -> tuple[Floats, Floats]:
        """s and t of the points nearest to each other: the lines' nearest points, brought within the segments in turn."""
        uu, vv, uv = _dot(self.u, self.u), _dot(self.v, self.v), _dot(self.u, self.v)
        ug, vg = _dot(self.u, self.gap), _dot(self.v, self.gap)
        uu, vv = np.maximum(uu, _POINT), np.maximum(vv, _POINT)
        spread = np.maximum(uu * vv - uv * uv, _POINT * uu * vv)
        s = _unit((ug * vv - vg * uv) / spread)
        t = _unit((s * uv - vg) / vv)
        return _unit((t * uv + ug) / uu), t


def _signed(c: Floats, w: Floats, options: Interaction) -> Floats:
    """k from c·w and w·w, backwards in time too; 0 within the dead band."""
    square = _dot(w, w)
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.ceil(-_dot(c, w) / square - 0.5)
    return np.where(square > options.dead_band**2, best, 0.0)


def _squared(c: Floats, w: Floats, k: Floats) -> Floats:
    reached = c + k * w
    return _dot(reached, reached)


def _dot(a: Floats, b: Floats) -> Floats:
    product = a * b
    total = product[0]
    total += product[1]
    total += product[2]
    return total


def _unit(values: Floats) -> Floats:
    return np.minimum(np.maximum(values, 0.0), 1.0)


def _products(first: list[int], second: list[int]) -> Ints:
    """(2, N) every capsule of one link with every capsule of the other."""
    return np.stack(np.meshgrid(first, second, indexing="ij")).reshape(2, -1)
