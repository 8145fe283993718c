"""On which feet the robot stands while it plays a clip: not the human's labels, but what they mean for flat hard soles.

A human lifts a heel, rolls onto the toes, shifts a foot by a centimetre; a small robot with stiff soles keeps such a
foot flat where it is. Only a foot that is lifted well, or that comes down elsewhere, is taken off the floor.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d, uniform_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.errors import BalanceError
from robot_retarget.retarget.contacts import intervals
from robot_retarget.retarget.footing import flattened, smoothstep

GAP = 0.6
"""Between two soles there is at least this share of what is between them in the robot's own stand."""
APART = 8
"""Rounds of moving footholds apart: a step to the side may bring the next one nearer."""
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Takes a direction (2,) to the one on its left."""


@dataclass(frozen=True)
class StepRule:
    """What counts as a step of the robot; lengths in units of its leg."""

    speed: float = 0.6
    """A sole slower than this [1/s] ..."""
    height: float = 0.06
    """... and lower than this stands, whatever the human's label says."""
    drift: float = 0.6
    """The lowest sole within this time to either side is on the floor: captures lose their height [s]."""
    shortest: float = 0.12
    """A stance or a swing shorter than this is noise; without a foot on the floor for longer, it is a jump [s]."""
    lift: float = 0.12
    """A foot lifted less ..."""
    travel: float = 0.3
    """... and with all corners put down nearer to where they stood stays planted."""


def planted_feet(
    stances: dict[str, np.ndarray],
    feet: tuple[str, ...],
    corners: Floats,
    leg: float,
    fps: float,
    rule: StepRule | None = None,
) -> np.ndarray:
    """(T, F) which feet of the robot stand on the floor or nearly so; at least one at every frame.

    Args:
        stances: the human's, per foot (T, 2) toe and heel (`contacts.stances`).
        corners: (T, F, 4, 3) of the robot's soles as retargeted [m].

    Raises:
        BalanceError: the motion leaves the floor.
    """
    chosen = rule or StepRule()
    low, speed = _over_floor(corners, chosen.drift * fps), _speed(corners, fps)
    _refuse_flight(low.min(axis=1) > chosen.height * leg, fps, chosen)
    told = [stances[f].any(axis=1) if f in stances else np.zeros(len(corners), bool) for f in feet]
    planted = np.stack(told, axis=1) | ((low < chosen.height * leg) & (speed < chosen.speed * leg))
    planted = median_filter(planted, (2 * round(chosen.shortest * fps / 2) + 1, 1), mode="nearest")
    nobody = np.flatnonzero(~planted.any(axis=1))
    planted[nobody, speed[nobody].argmin(axis=1)] = True
    return planted


def kept_down(planted: np.ndarray, corners: Floats, leg: float, fps: float, rule: StepRule | None = None) -> np.ndarray:
    """(T, F) without swings that neither lift a foot nor carry it away; both feet down where weight goes across."""
    chosen, kept = rule or StepRule(), planted.copy()
    low = _over_floor(corners, chosen.drift * fps)
    for foot in range(planted.shape[1]):
        stood = 0
        for start, stop in intervals(~planted[:, foot]):
            away = _moved(corners[:, foot], stood + 1, stop)
            if low[start:stop, foot].max() < chosen.lift * leg and away < chosen.travel * leg:
                kept[start:stop, foot] = True
            else:
                stood = min(stop, len(planted) - 1)
    _hand_over(kept)
    return kept


def parted(corners: Floats, own: Floats) -> Floats:
    """(T, 2, 4, 3) two feet moved apart to either side where they are nearer to each other than in the stand `own`.

    A human sets narrow feet past each other closely; large soles cannot pass.
    """
    width = _across(own[None])[0]
    missing = np.maximum(width - _across(corners), GAP * gaps(own[None])[0] - gaps(corners))
    aside = np.maximum(missing, 0.0)[:, None] / 2 * _left(corners)
    apart = corners.copy()
    apart[:, 0, :, :2] += aside[:, None]
    apart[:, 1, :, :2] -= aside[:, None]
    return apart


def gaps(corners: Floats) -> Floats:
    """(T,) between two soles (T, 2, 4, 3), negative where they overlap: the widest along the edges of either [m]."""
    flat = corners[..., :2]
    ahead = flat[:, :, :2].mean(axis=2) - flat[:, :, 2:].mean(axis=2)
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=2, keepdims=True), 1e-9)
    axes = np.concatenate([ahead, ahead @ _TURN], axis=1)
    along = np.einsum("tfci,tai->tafc", flat, axes)
    least, most = along.min(axis=3), along.max(axis=3)
    return np.maximum(least[..., 0] - most[..., 1], least[..., 1] - most[..., 0]).max(axis=1)


def _across(corners: Floats) -> Floats:
    """(T,) how far the first foot is to the left of the second, as both point [m]."""
    return ((corners[:, 0] - corners[:, 1]).mean(axis=1)[:, :2] * _left(corners)).sum(axis=1)


def _left(corners: Floats) -> Floats:
    """(T, 2) unit vectors to the left of where both feet (T, F, 4, 3) point."""
    return _ahead(corners) @ _TURN


def _ahead(corners: Floats) -> Floats:
    """(T, 2) unit vectors along which both feet (T, F, 4, 3) point."""
    ahead = (corners[..., :2, :2].mean(axis=2) - corners[..., 2:, :2].mean(axis=2)).sum(axis=1)
    return ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)


def _moved(corners: Floats, start: int, stop: int) -> float:
    """How far the furthest corner of a foot (T, 4, 3) goes from the frame before `start` to the frame `stop` [m]."""
    before, after = max(start - 1, 0), min(stop, len(corners) - 1)
    return float(np.linalg.norm((corners[after] - corners[before])[:, :2], axis=1).max())


def _over_floor(corners: Floats, reach: float) -> Floats:
    """(T, F) height of the lowest corner over the lowest of all within `reach` frames [m]."""
    low = corners[..., 2].min(axis=2)
    floor = minimum_filter1d(low.min(axis=1), 2 * round(reach) + 1, mode="nearest")
    return low - floor[:, None]


def _speed(corners: Floats, fps: float) -> Floats:
    """(T, F) of the soles' middles along the floor, over a tenth of a second [m/s]."""
    middle = uniform_filter1d(corners.mean(axis=2)[..., :2], max(1, round(0.1 * fps)), axis=0, mode="nearest")
    return np.linalg.norm(np.gradient(middle, 1 / fps, axis=0), axis=2)


def _refuse_flight(airborne: np.ndarray, fps: float, rule: StepRule) -> None:
    for start, stop in intervals(airborne):
        if (stop - start) / fps > rule.shortest:
            raise BalanceError(
                f"no foot is on the floor from {start / fps:.1f} to {stop / fps:.1f} s: a robot that stands free cannot "
                "play that; keep both feet on the floor (legs 'stand'), or do without balance (balance 'off')"
            )


def _hand_over(planted: np.ndarray) -> None:
    """Where one frame stands on one foot and the next on another, both frames stand on both."""
    switch = np.flatnonzero(~(planted[:-1] & planted[1:]).any(axis=1))
    both = planted[switch] | planted[switch + 1]
    planted[switch], planted[switch + 1] = both, both


def foothold_places(planted: np.ndarray, corners: Floats, lift: float, gap: float) -> Floats:
    """(T, F, 4, 3) where the corners go: flat and still in stance, over a low arc from foothold to foothold between.

    In the middle of a swing a foot is where the draft `corners` have it, where that is higher than the arc, but level: a
    heel that is thrown up behind and set down in front costs a small leg all its speed. Near both ends it rises from
    its foothold and comes down on the next.

    Args:
        planted: (T, F); the first and the last frame stand on all feet.
        corners: (T, F, 4, 3) of the draft [m].
        lift: height of the arc [m].
        gap: least between two feet [m]: footholds move apart, and a foot in the air goes around the one that stands.
    """
    places = corners.copy()
    for foot in range(planted.shape[1]):
        for start, stop in intervals(planted[:, foot]):
            places[start:stop, foot] = flattened(np.median(corners[start:stop, foot], axis=0))
    places = _set_apart(places, planted, gap)
    for foot in range(planted.shape[1]):
        for start, stop in intervals(~planted[:, foot]):
            ends = places[start - 1, foot], places[stop, foot]
            places[start:stop, foot] = _swing(*ends, corners[start - 1 : stop + 1, foot], lift)
    return _around(places, planted, gap)


def _set_apart(places: Floats, planted: np.ndarray, gap: float) -> Floats:
    """The places, footholds that are held at the same time moved to either side until the gap is between them."""
    apart, both = places.copy(), planted.all(axis=1)
    for _ in range(APART):
        missing = np.where(both, np.maximum(gap - gaps(apart), 0.0), 0.0)
        left = _left(apart)
        for foot, side in ((0, 0.5), (1, -0.5)):
            for start, stop in intervals(planted[:, foot]):
                worst = start + int(missing[start:stop].argmax())
                apart[start:stop, foot, :, :2] += side * missing[worst] * left[worst]
    return apart


def _around(places: Floats, planted: np.ndarray, gap: float) -> Floats:
    """The places, a foot in the air further to its own side where the gap to the one that stands is too small."""
    missing, left, round_it = np.maximum(gap - gaps(places), 0.0), _left(places), places.copy()
    for foot, side in ((0, 1.0), (1, -1.0)):
        for start, stop in intervals(~planted[:, foot]):
            part = _ramp(np.arange(1, stop - start + 1) / (stop - start + 1))
            aside = side * (part * missing[start:stop])[:, None] * left[start:stop]
            round_it[start:stop, foot, :, :2] += aside[:, None]
    return round_it


def _ramp(share: Floats) -> Floats:
    """1 in the middle of a swing, 0 at both ends."""
    return smoothstep(np.clip(np.minimum(share, 1 - share) * 3, 0.0, 1.0))


def _level(corners: Floats) -> Floats:
    """(S, 4, 3) soles as high as their lowest corner, parallel to the floor."""
    flat = flattened(corners)
    flat[..., 2] = corners[..., 2].min(axis=-1, keepdims=True)
    return flat


def _swing(start: Floats, end: Floats, draft: Floats, lift: float) -> Floats:
    """(S, 4, 3) between two footholds; `draft` (S + 2, 4, 3) begins and ends a frame outside."""
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
