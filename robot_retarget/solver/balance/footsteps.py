"""Footsteps of the robot: which feet stand, where they stand, and the paths of the soles between.

    labels ──planted_feet──▶ stances ──spread, reachable_footholds──▶ footholds ──foothold_places──▶ paths of the soles

Soles are their corners (T, F, 4, 3) in the order of `robot.support.CORNER_NAMES`, the left foot first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_retarget.base.arrays import Floats, intervals, leftward, smoothstep, unit
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import ContactRule, over_lowest, without_flicker
from robot_retarget.graph.soles import flattened, laid, lengths
from robot_retarget.scene.geoms import SolidGround, filled

# The feet on which the robot stands during a clip: the human's labels, adapted to flat hard soles.
#
# A human lifts a heel, rolls onto the toes, shifts a foot by a centimetre; a small robot with stiff soles keeps such a
# foot flat in place. The robot lifts a foot only if the human lifts it well, or puts it down elsewhere.


@dataclass(frozen=True)
class StepRule:
    """The definition of a step of the robot; lengths in units of its leg."""

    height: float = 0.06
    """A foot that is put down higher by more than this steps, however low it goes. Half and double change nothing in the sample walk."""
    lift: float = ContactRule.high
    """A foot lifted less ..."""
    travel: float = 0.3
    """... and with all corners put down nearer to their last stance stays planted. Half and double change nothing in the sample walk."""


def planted_feet(human: ContactRecord, draft: ContactRecord, corners: Floats, fps: float) -> np.ndarray:
    """Return (T, F) the feet of the robot that are to stand; at least one at every frame.

    Args:
        human: its contacts.
        draft: contacts of the robot's retargeted feet, F of them.
        corners: (T, F, 4, 3) corners of their soles [m].
    """
    labelled = np.stack([human.of(foot).any(axis=1) for foot in draft.feet], axis=1)
    planted = without_flicker(labelled | draft.planted, fps)
    nobody, speed = np.flatnonzero(~planted.any(axis=1)), _speed(corners, fps)
    planted[nobody, speed[nobody].argmin(axis=1)] = True
    return planted


def _heights(corners: Floats, fps: float, ground: SolidGround | None) -> Floats:
    """Return heights (T, F) of soles (T, F, 4, 3) over the ground; on a level floor over its drift [m]."""
    if ground is None or ground.level:
        return over_lowest(corners[..., 2].min(axis=2), fps)
    points = filled(corners)
    return ground.over(points.reshape(len(points), -1, 3)).reshape(points.shape[:3]).min(axis=2)


def without_small_swings(
    planted: np.ndarray, corners: Floats, leg: float, fps: float, ground: SolidGround | None = None
) -> np.ndarray:
    """Return planted feet without swings that neither lift nor displace a foot; weight transfers have both feet down.

    Args:
        planted: (T, F) feet on the floor.
        corners: (T, F, 4, 3) of the soles [m].
        leg: length of a leg [m].
        fps: frames per second [1/s].
        ground: under the soles; the floor alone by default.

    Returns:
        (T, F) feet on the ground.
    """
    chosen, kept = StepRule(), planted.copy()
    low, level = _heights(corners, fps, ground), ground is None or ground.level
    for foot in range(planted.shape[1]):
        stood = 0
        for start, stop in intervals(~planted[:, foot]):
            way = corners[min(stop, len(planted) - 1), foot] - corners[stood, foot]
            away, rises = np.linalg.norm(way[:, :2], axis=1).max(), abs(way[:, 2].mean()) > chosen.height * leg
            if low[start:stop, foot].max() < chosen.lift * leg and away < chosen.travel * leg and (level or not rises):
                kept[start:stop, foot] = True
            else:
                stood = min(stop, len(planted) - 1)
    switch = np.flatnonzero(~(kept[:-1] & kept[1:]).any(axis=1))  # both feet are down where one takes over
    kept[switch] = kept[switch + 1] = kept[switch] | kept[switch + 1]
    return kept


def _speed(corners: Floats, fps: float) -> Floats:
    """Return (T, F) speeds of the soles' middles along the floor, over a tenth of a second [m/s]."""
    middle = uniform_filter1d(corners.mean(axis=2)[..., :2], max(1, round(0.1 * fps)), axis=0, mode="nearest")
    return np.linalg.norm(np.gradient(middle, 1 / fps, axis=0), axis=2)


# Steps within the reach of short legs: the place of each foothold relative to the other foot's stance.
#
# A robot on flat soles reaches less far than a human who rolls over heel and toes: over a step its pelvis sinks until both
# legs reach the floor. The robot's own stand defines the place of each foot relative to the other. A foothold too far from that place moves nearer, and all later
# footholds move by the same amount, so steps within reach stay unchanged.

SINK = 0.055
"""Largest depth by which the pelvis sinks over a step of straight legs, over the leg length: in the middle of the next stance the knee
bends as far. The OP3's steps of 0.5 to 0.65 of a leg fall as rarely as those of 0.35."""
REACH = 2 * np.sqrt(1 - (1 - SINK) ** 2)
"""Largest distance of a foothold from its place next to the other foot, over the leg length."""


def reachable_footholds(planted: np.ndarray, corners: Floats, own: Floats, leg: float, reach: float = REACH) -> Floats:
    """Return (T, 2, 4, 3) soles with footholds within reach of each other.

    Args:
        planted: (T, 2), at least one foot at every frame, both during a transfer of weight.
        corners: (T, 2, 4, 3) target corners of the soles [m].
        own: (2, 4, 3) corners in the robot's own stand [m].
    """
    middle, beside = corners.mean(axis=2)[..., :2], _complex((own[1] - own[0]).mean(axis=0)[:2])
    place = beside * _complex(ahead(corners)) / _complex(ahead(own[None]))
    places = np.stack([-place, place], axis=1)
    moved = _shifts(planted, _complex(middle), places, reach * leg)
    placed = corners.copy()
    placed[..., 0] += np.real(moved)[:, :, None]
    placed[..., 1] += np.imag(moved)[:, :, None]
    return placed


def _shifts(planted: np.ndarray, middle: np.ndarray, places: np.ndarray, reach: float) -> np.ndarray:
    """Return (T, 2) shifts of the soles as complex numbers; each has its place (T, 2) relative to the other."""
    moved = np.zeros_like(middle)
    stances = sorted((start, foot, stop) for foot in range(2) for start, stop in intervals(planted[:, foot]))
    for start, foot, stop in stances[1:]:
        other = next(slice(*span) for span in intervals(planted[:, 1 - foot]) if span[0] <= start <= span[1])
        apart = _median(middle[start:stop, foot]) - _median(middle[other, 1 - foot])
        beyond = _beyond(apart - places[start, foot], reach)
        moved[start:stop, foot] = moved[other.start, 1 - foot] - beyond
    for foot in np.flatnonzero(planted.any(axis=0)):
        air, known = np.flatnonzero(~planted[:, foot]), np.flatnonzero(planted[:, foot])
        moved[air, foot] = np.interp(air, known, moved[known, foot])
        apart = (middle + moved)[air, foot] - (middle + moved)[air, 1 - foot]
        moved[air, foot] -= _beyond(apart - places[air, foot], reach)
    return moved


def _beyond(apart: np.ndarray, reach: float) -> np.ndarray:
    """Return the excess of complex numbers over their largest length."""
    return apart * (1 - np.minimum(1.0, reach / np.maximum(np.abs(apart), 1e-9)))


def total_step_length(planted: np.ndarray, corners: Floats) -> float:
    """Return the summed length of the steps of all feet [m].

    Args:
        planted: (T, F) feet on the floor.
        corners: (T, F, 4, 3) of the soles [m].
    """
    middle, total = corners.mean(axis=2)[..., :2], 0.0
    for foot in range(planted.shape[1]):
        stances = [np.median(middle[start:stop, foot], axis=0) for start, stop in intervals(planted[:, foot])]
        total += float(np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()) if len(stances) > 1 else 0.0
    return total


def _complex(flat: Floats) -> np.ndarray:
    """Return points (…, 2) of the floor as complex numbers, so that multiplication rotates them."""
    return flat[..., 0] + 1j * flat[..., 1]


def _median(places: np.ndarray) -> complex:
    """Return the median of complex numbers, axis by axis."""
    return complex(np.median(np.real(places)), np.median(np.imag(places)))


# Two adjacent soles: their heading, their distance, and their separation.
#
# Soles are their corners (T, F, 4, 3) in the order of `robot.support.CORNER_NAMES`, the left foot first.

LEAST_GAP = 0.6
"""Least gap between two soles, as a share of the gap in the robot's own stand. Half changes nothing in the sample walk on the
OP3; with double its legs are 0.4° further from the human's."""


def spread(corners: Floats, own: Floats) -> Floats:
    """Return (T, 2, 4, 3) both feet, moved apart if they are nearer than in the stand `own`.

    A human moves narrow feet past each other closely; large soles cannot pass.
    """
    width = across(own[None])[0]
    missing = np.maximum(width - across(corners), LEAST_GAP * gaps(own[None])[0] - gaps(corners))
    aside = np.maximum(missing, 0.0)[:, None] / 2 * left(corners)
    apart = corners.copy()
    apart[:, 0, :, :2] += aside[:, None]
    apart[:, 1, :, :2] -= aside[:, None]
    return apart


def gaps(corners: Floats) -> Floats:
    """Return (T,) gaps between two soles (T, 2, 4, 3), negative for overlap: the widest along their edges [m]."""
    flat = corners[..., :2]
    along = unit(lengths(corners))
    axes = np.concatenate([along, leftward(along)], axis=1)
    extent = np.einsum("tfci,tai->tafc", flat, axes)
    lower, upper = extent.min(axis=3), extent.max(axis=3)
    return np.maximum(lower[..., 0] - upper[..., 1], lower[..., 1] - upper[..., 0]).max(axis=1)


def across(corners: Floats) -> Floats:
    """Return (T,) the distance of the first foot to the left of the second, relative to their common heading [m]."""
    return ((corners[:, 0] - corners[:, 1]).mean(axis=1)[:, :2] * left(corners)).sum(axis=1)


def left(corners: Floats) -> Floats:
    """Return (T, 2) unit vectors to the left of the common heading of both feet (T, F, 4, 3)."""
    return leftward(ahead(corners))


def ahead(corners: Floats) -> Floats:
    """Return (T, 2) unit vectors along the common heading of both feet (T, F, 4, 3)."""
    return unit(lengths(corners).sum(axis=1))


# The paths of soles: from foothold to foothold, around the standing foot.

APART_ROUNDS = 8
"""Rounds of moving footholds apart: a step to the side may reduce the next gap. Half and double change nothing in the sample walk."""


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
        while len(kept) > 1 and np.interp(kept[-1], [kept[-2], k], heights[[kept[-2], k]]) >= heights[kept[-1]]:
            kept.pop()
        kept.append(k)
    return np.interp(np.arange(len(heights)), kept, heights[kept])


def _set_apart(places: Floats, planted: np.ndarray, gap: float) -> Floats:
    """Return places with simultaneous footholds moved to either side until the gap is between them."""
    apart, both = places.copy(), planted.all(axis=1)
    for _ in range(APART_ROUNDS):
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


def _swing(start: Floats, end: Floats, draft: Floats, lift: float) -> Floats:
    """Return (S, 4, 3) corners between two footholds; `draft` (S + 2, 4, 3) starts and ends a frame outside."""
    inner = len(draft) - 2
    share = (np.arange(1, inner + 1) / (inner + 1))[:, None, None]
    line = start + smoothstep(share) * (end - start)
    shift = (1 - smoothstep(share)) * (start - draft[0]) + smoothstep(share) * (end - draft[-1])
    own = flattened(draft[1:-1]) + shift * [1.0, 1.0, 0.0]  # level, at the height of its lowest corner
    own[..., 2] = draft[1:-1, :, 2].min(axis=1, keepdims=True)
    placed = line + _ramp(share) * (own - line)
    arc = lift * np.sin(np.pi * share[:, 0, 0]) ** 2
    missing = np.maximum(arc - placed[:, :, 2].min(axis=1), 0.0)
    placed[:, :, 2] += missing[:, None]
    return placed
