"""The interaction distance [Mucherino2019, §4] of surfaces: how close two links come if both keep their last step.

A link is a set of capsules whose ends p move by s = p^t − p^(t−1) in one step, so that after k more steps they stand at
p + k s. At k = 0 the points of two segments that are nearest to each other have the separation c and the relative step
w; the closed form of `dgp.interaction` gives the k at which *these points* are nearest. There the segments have other
nearest points, for which the closed form is asked again. Every round lowers the distance; with r the radii,

    D = ‖c + k w‖ − r_u − r_v,    α = 1 + k,    D ≤ distance now.

All pairs are one CasADi function of dense vectors, a coordinate each: its work stays in the processor's first cache, so
a frame of a stream costs what a frame among many does. Choices are sums of products with 0 and 1, which are fast.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.dgp.interaction import Interaction
from robot_retarget.robot.capsules import Capsules
from robot_retarget.robot.clearance import Pairs
from robot_retarget.solve.compiled import Compiled

REST = Interaction(horizon=0)
"""Looks at no step ahead: D is the distance now."""
BLOCK = 16
"""Frames handed over at once."""
_POINT = 1e-12
"""Added to squared lengths, so that those of points divide [m²]; and to 1 for segments that are parallel."""
_STILL = 1e-300
"""Added to squared steps, so that those of rest divide [m²]."""


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
        self.count, self.radius, self.layers = len(pairs), capsules.radius, _layers(tables)

    def approach(self, ends: Floats, steps: Floats, options: Interaction) -> Approach:
        """D and α of every pair from the ends of the capsules and their last steps, T frames of 6C numbers each [m]."""
        limits = np.array([math.floor(options.farthest), options.dead_band**2])
        found, whole = np.empty((3, len(ends), self.count)), len(ends) - len(ends) % BLOCK
        many = np.tile(limits, BLOCK) if whole else limits
        for start in range(0, whole if self.count else 0, BLOCK):
            part = slice(start, start + BLOCK)
            for field, values in zip(found, self._block(ends[part].ravel(), steps[part].ravel(), many), strict=True):
                field[part] = values.T
        for t in range(whole, len(ends) if self.count else 0):
            for field, values in zip(found, self._frame(ends[t].ravel(), steps[t].ravel(), limits), strict=True):
                field[t] = values
        return Approach(found[0], found[1], found[2].astype(np.int64))

    @cached_property
    def _frame(self) -> Compiled:
        """The closed form for one frame."""
        return Compiled(self._closed_form)

    @cached_property
    def _block(self) -> Compiled:
        """The same for several frames."""
        return Compiled(self._closed_form.map(BLOCK))

    @cached_property
    def _closed_form(self) -> ca.Function:
        """Ends (6C), steps (6C), farthest k and squared dead band (2) ↦ distance, D and α, (P) each."""
        ends, steps = ca.MX.sym("ends", 6 * len(self.radius)), ca.MX.sym("steps", 6 * len(self.radius))
        bounds = ca.MX.sym("bounds", 2)
        found = self._least(*self._of_capsules(ends, steps, bounds[0], bounds[1]))
        return ca.Function("approach", [ends, steps, bounds], found)

    def _of_capsules(self, ends: Any, steps: Any, farthest: Any, band: Any) -> tuple[Any, Any, Any]:
        """Distance, D and α of pairs of capsules, layer by layer."""
        first, second = np.concatenate([pairs for _, pairs in self.layers]).T
        now, step = _rods(ends, first, second), _rods(steps, first, second)
        s, t = now.nearest()
        c, w = now.between(s, t), step.between(s, t)
        k = _clip(_signed(c, w, band), farthest)
        near = _squared(c, w, k)
        there = now.moved(step, k)
        s, t = there.nearest()
        later, w = there.between(s, t), step.between(s, t)
        k2 = _clip(k + _signed(later, w, band), farthest)
        again = _squared(later, w, k2 - k)
        radii = ca.DM(self.radius[first] + self.radius[second])
        ahead = ca.sqrt(_chosen(again < near, again, near)) - radii
        return ca.sqrt(_dot(c, c)) - radii, ahead, 1 + _chosen(again < near, k2, k)

    def _least(self, distance: Any, ahead: Any, alpha: Any) -> list[Any]:
        """From capsule pairs to pairs of links: the nearest now, and the nearest ahead with its α."""
        least, start = [values[: self.count] for values in (distance, ahead, alpha)], self.count
        for owners, _ in self.layers[1:]:
            near, later, when = (values[start : start + len(owners)] for values in (distance, ahead, alpha))
            start += len(owners)
            nearer, sooner = near < least[0][owners], later < least[1][owners]
            for value, which, more in zip(least, (nearer, sooner, sooner), (near, later, when), strict=True):
                value[owners] = _chosen(which, more, value[owners])
        return least


@dataclass(frozen=True, eq=False)
class _Rods:
    """Pairs of segments: from the one base to the other, and along each; three coordinates, N pairs."""

    gap: list[Any]
    u: list[Any]
    v: list[Any]

    def moved(self, step: "_Rods", k: Any) -> "_Rods":
        """The same k steps later."""
        ways = zip((self.gap, self.u, self.v), (step.gap, step.u, step.v), strict=True)
        return _Rods(*([a + k * b for a, b in zip(now, along, strict=True)] for now, along in ways))

    def between(self, s: Any, t: Any) -> list[Any]:
        """From the point at s on the first to the point at t on the second."""
        return [g + t * b - s * a for g, a, b in zip(self.gap, self.u, self.v, strict=True)]

    def nearest(self) -> tuple[Any, Any]:
        """s and t of the points nearest to each other: the lines' nearest points, brought within the segments in turn."""
        uu, vv, uv = _dot(self.u, self.u) + _POINT, _dot(self.v, self.v) + _POINT, _dot(self.u, self.v)
        ug, vg = _dot(self.u, self.gap), _dot(self.v, self.gap)
        s = _clip((ug * vv - vg * uv) / ((1 + _POINT) * uu * vv - uv * uv), 1)
        t = _clip((s * uv - vg) / vv, 1)
        return _clip((t * uv + ug) / uu, 1), t


def _rods(ends: Any, first: Ints, second: Ints) -> _Rods:
    """Of capsules (N,) and capsules (N,), from all ends: capsule by capsule, end by end, coordinate by coordinate."""
    bases = [ends[axis::6] for axis in range(3)]
    along = [ends[3 + axis :: 6] - bases[axis] for axis in range(3)]
    gap = [base[second.tolist()] - base[first.tolist()] for base in bases]
    return _Rods(gap, [way[first.tolist()] for way in along], [way[second.tolist()] for way in along])


def _signed(c: list[Any], w: list[Any], band: Any) -> Any:
    """k = ⌈−c·w / w·w − ½⌉, backwards in time too; 0 within the dead band."""
    square = _dot(w, w)
    return (square > band) * ca.ceil(-_dot(c, w) / (square + _STILL) - 0.5)


def _squared(c: list[Any], w: list[Any], k: Any) -> Any:
    reached = [a + k * b for a, b in zip(c, w, strict=True)]
    return _dot(reached, reached)


def _dot(a: list[Any], b: list[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _clip(x: Any, most: Any) -> Any:
    """x brought within 0 … most."""
    return x * ((x > 0) * (x <= most)) + most * (x > most)


def _chosen(which: Any, a: Any, b: Any) -> Any:
    """a where `which` is 1, b where it is 0."""
    return which * a + (1 - which) * b


def _products(first: list[int], second: list[int]) -> Ints:
    """(N, 2) every capsule of one link with every capsule of the other."""
    return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)


def _layers(tables: list[Ints]) -> list[tuple[list[int], Ints]]:
    """The first pair of capsules of every pair of links, the second of those that have two, and so on: owners, pairs."""
    depth = max(map(len, tables), default=0)
    owners = [[k for k, table in enumerate(tables) if len(table) > layer] for layer in range(depth)]
    return [(some, np.array([tables[k][layer] for k in some])) for layer, some in enumerate(owners)]
