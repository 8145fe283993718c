"""The paths of soles: from foothold to foothold, around the standing foot."""

import numpy as np

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.base.ramps import smoothstep
from robot_retarget.graph.soles import flattened, laid
from robot_retarget.scene.ground import SolidGround, filled
from robot_retarget.solver.balance.foot_spacing import gaps, left

APART = 8
"""Rounds of moving footholds apart: a step to the side may reduce the next gap."""


def foothold_places(
    planted: np.ndarray, corners: Floats, lift: float, gap: float, ground: SolidGround | None = None
) -> Floats:
    """Return (T, F, 4, 3) corners: flat on the ground and still in stance, on a low arc from foothold to foothold between.

    In the middle of a swing, a foot follows the draft `corners` if they are higher than the arc, but stays level: a heel
    raised far behind and set down in front needs all the speed of a small leg. Near both ends it rises from its
    foothold and comes down on the next.

    Args:
        planted: (T, F); the first and the last frame stand on all feet.
        corners: (T, F, 4, 3) corners of the draft [m].
        lift: height of the arc [m].
        gap: least gap between two feet [m]: footholds move apart, and a foot in the air goes around the standing one.
        ground: under the feet; the floor alone by default.
    """
    places, under = corners.copy(), ground or SolidGround()
    for foot in range(planted.shape[1]):
        for start, stop in intervals(planted[:, foot]):
            places[start:stop, foot] = laid_on(under, np.median(corners[start:stop, foot], axis=0), lift)
    places = _set_apart(places, planted, gap)
    for foot in range(planted.shape[1]):
        for start, stop in intervals(~planted[:, foot]):
            ends = places[start - 1, foot], places[stop, foot]
            places[start:stop, foot] = _swing(*ends, corners[start - 1 : stop + 1, foot], lift)
    places = _around(places, planted, gap)
    return places if under.level else _over_edges(places, planted, lift, under)


def laid_on(ground: SolidGround, corners: Floats, above: float) -> Floats:
    """Return a sole (4, 3) flat on the surface that it stands on, the highest of those up to `above` over it [m]."""
    return flattened(corners) if ground.level else laid(corners, *ground.plane(filled(corners), above))


def _over_edges(places: Floats, planted: np.ndarray, lift: float, ground: SolidGround) -> Floats:
    """Return places with swings raised to go a lift over the ground between their ends, on the lowest arc without a dip.

    The arc is the concave envelope over time of the heights that the sole needs: it rises before an edge and comes down behind it.
    """
    over = places.copy()
    for foot in range(planted.shape[1]):
        for start, stop in intervals(~planted[:, foot]):
            swing = slice(start - 1, stop + 1)
            low, share = places[swing, foot, :, 2].min(axis=1), np.linspace(0.0, 1.0, stop - start + 2)
            soles, ends = filled(places[swing, foot]), [0, -1]
            soles[..., 2] = low.max()
            needed = ground.under(soles, lift)[0].max(axis=1) + lift * np.sin(np.pi * share) ** 2
            needed[ends] = low[ends]
            over[swing, foot, :, 2] += np.maximum(_envelope(needed) - low, 0.0)[:, None]
    return over


def _envelope(heights: Floats) -> Floats:
    """Return the lowest concave sequence (S,) that is nowhere under `heights`."""
    kept: list[int] = []
    for k in range(len(heights)):
        while len(kept) > 1 and _dips(heights, kept[-2], kept[-1], k):
            kept.pop()
        kept.append(k)
    return np.interp(np.arange(len(heights)), kept, heights[kept])


def _dips(heights: Floats, a: int, b: int, c: int) -> bool:
    return bool((heights[b] - heights[a]) * (c - a) <= (heights[c] - heights[a]) * (b - a))


def _set_apart(places: Floats, planted: np.ndarray, gap: float) -> Floats:
    """Return places with simultaneous footholds moved to either side until the gap is between them."""
    apart, both = places.copy(), planted.all(axis=1)
    for _ in range(APART):
        missing = np.where(both, np.maximum(gap - gaps(apart), 0.0), 0.0)
        aside = left(apart)
        for foot, side in ((0, 0.5), (1, -0.5)):
            for start, stop in intervals(planted[:, foot]):
                worst = start + int(missing[start:stop].argmax())
                apart[start:stop, foot, :, :2] += side * missing[worst] * aside[worst]
    return apart


def _around(places: Floats, planted: np.ndarray, gap: float) -> Floats:
    """Return places with a foot in the air moved to its own side where its gap to the standing foot is too small."""
    missing, outward, round_it = np.maximum(gap - gaps(places), 0.0), left(places), places.copy()
    for foot, side in ((0, 1.0), (1, -1.0)):
        for start, stop in intervals(~planted[:, foot]):
            part = _ramp(np.arange(1, stop - start + 1) / (stop - start + 1))
            aside = side * (part * missing[start:stop])[:, None] * outward[start:stop]
            round_it[start:stop, foot, :, :2] += aside[:, None]
    return round_it


def _ramp(share: Floats) -> Floats:
    """Return 1 in the middle of a swing, 0 at both ends."""
    return smoothstep(np.clip(np.minimum(share, 1 - share) * 3, 0.0, 1.0))


def _level(corners: Floats) -> Floats:
    """Return (S, 4, 3) soles at the height of their lowest corner, parallel to the floor."""
    flat = flattened(corners)
    flat[..., 2] = corners[..., 2].min(axis=-1, keepdims=True)
    return flat


def _swing(start: Floats, end: Floats, draft: Floats, lift: float) -> Floats:
    """Return (S, 4, 3) corners between two footholds; `draft` (S + 2, 4, 3) starts and ends a frame outside."""
    inner = len(draft) - 2
    share = (np.arange(1, inner + 1) / (inner + 1))[:, None, None]
    line = start + smoothstep(share) * (end - start)
    shift = (1 - smoothstep(share)) * (start - draft[0]) + smoothstep(share) * (end - draft[-1])
    own = _level(draft[1:-1]) + shift * [1.0, 1.0, 0.0]
    placed = line + _ramp(share) * (own - line)
    arc = lift * np.sin(np.pi * share[:, 0, 0]) ** 2
    missing = np.maximum(arc - placed[:, :, 2].min(axis=1), 0.0)
    placed[:, :, 2] += missing[:, None]
    return placed
