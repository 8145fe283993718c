"""The feet on which the robot stands during a clip: the human's labels, adapted to flat hard soles.

A human lifts a heel, rolls onto the toes, shifts a foot by a centimetre; a small robot with stiff soles keeps such a
foot flat in place. The robot lifts a foot only if the human lifts it well, or puts it down elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.base.errors import BalanceError
from robot_retarget.human.stance import StanceRule, over_lowest, without_flicker
from robot_retarget.scene.ground import SolidGround, filled


@dataclass(frozen=True)
class StepRule:
    """The definition of a step of the robot; lengths in units of its leg."""

    speed: float = 0.6
    """A sole slower than this [1/s] ..."""
    height: float = 0.06
    """... and lower than this stands, regardless of the human's label."""
    flight: float = 0.12
    """A longer time without a foot on the floor, with both feet higher than `lift` in between, is a jump [s]."""
    lift: float = 0.12
    """A foot lifted less ..."""
    travel: float = 0.3
    """... and with all corners put down nearer to their last stance stays planted."""


def planted_feet(
    stances: dict[str, np.ndarray],
    feet: tuple[str, ...],
    corners: Floats,
    leg: float,
    fps: float,
    rule: StepRule | None = None,
    ground: SolidGround | None = None,
) -> np.ndarray:
    """Return (T, F) the feet of the robot on the ground or nearly so; at least one at every frame.

    Args:
        stances: the human's, per foot (T, 2) toe and heel (`contacts.contact_schedule`).
        corners: (T, F, 4, 3) corners of the robot's retargeted soles [m].
        ground: under them; the floor alone by default.

    Raises:
        BalanceError: the motion leaves the floor.
    """
    chosen = rule or StepRule()
    low, speed = _heights(corners, fps, ground, np.median), _speed(corners, fps)
    _refuse_flight(_heights(corners, fps, ground).min(axis=1) / leg, fps, chosen)
    labelled = [stances[f].any(axis=1) if f in stances else np.zeros(len(corners), bool) for f in feet]
    planted = np.stack(labelled, axis=1) | ((low < chosen.height * leg) & (speed < chosen.speed * leg))
    planted = without_flicker(planted, fps, StanceRule())
    nobody = np.flatnonzero(~planted.any(axis=1))
    planted[nobody, speed[nobody].argmin(axis=1)] = True
    return planted


def _heights(corners: Floats, fps: float, ground: SolidGround | None, of: Callable[..., Floats] = np.min) -> Floats:
    """Return heights (T, F) of soles (T, F, 4, 3) over the ground; on a level floor over its drift [m].

    Args:
        of: `np.min` of the points of a sole; `np.median` if half of it must be low: toes over an edge carry no load.
    """
    if ground is None or ground.level:
        return over_lowest(corners[..., 2].min(axis=2), fps)
    points = filled(corners)
    return of(ground.over(points.reshape(len(points), -1, 3)).reshape(points.shape[:3]), axis=2)


def without_small_swings(
    planted: np.ndarray,
    corners: Floats,
    leg: float,
    fps: float,
    rule: StepRule | None = None,
    ground: SolidGround | None = None,
) -> np.ndarray:
    """Return planted feet without swings that neither lift nor displace a foot; weight transfers have both feet down.

    Args:
        planted: (T, F) feet on the floor.
        corners: (T, F, 4, 3) of the soles [m].
        leg: length of a leg [m].
        fps: frames per second [1/s].
        rule: the definition of a step.
        ground: under the soles; the floor alone by default.

    Returns:
        (T, F) feet on the ground.
    """
    chosen, kept = rule or StepRule(), planted.copy()
    low, level = _heights(corners, fps, ground), ground is None or ground.level
    for foot in range(planted.shape[1]):
        stood = 0
        for start, stop in intervals(~planted[:, foot]):
            away, higher = _moved(corners[:, foot], stood + 1, stop)
            rises = not level and higher > chosen.height * leg
            if low[start:stop, foot].max() < chosen.lift * leg and away < chosen.travel * leg and not rises:
                kept[start:stop, foot] = True
            else:
                stood = min(stop, len(planted) - 1)
    _hand_over(kept)
    return kept


def _moved(corners: Floats, start: int, stop: int) -> tuple[float, float]:
    """Return the largest corner displacement of a foot (T, 4, 3) along the floor, and that of its middle up or down, from the frame before `start` to `stop` [m]."""
    before, after = max(start - 1, 0), min(stop, len(corners) - 1)
    way = corners[after] - corners[before]
    return float(np.linalg.norm(way[:, :2], axis=1).max()), abs(float(way[:, 2].mean()))


def _speed(corners: Floats, fps: float) -> Floats:
    """Return (T, F) speeds of the soles' middles along the floor, over a tenth of a second [m/s]."""
    middle = uniform_filter1d(corners.mean(axis=2)[..., :2], max(1, round(0.1 * fps)), axis=0, mode="nearest")
    return np.linalg.norm(np.gradient(middle, 1 / fps, axis=0), axis=2)


def _refuse_flight(lowest: Floats, fps: float, rule: StepRule) -> None:
    """Raises: BalanceError: the lowest foot, at heights (T,) in legs, is in the air for a jump."""
    for start, stop in intervals(lowest > rule.height):
        if (stop - start) / fps > rule.flight and lowest[start:stop].max() > rule.lift:
            raise BalanceError(
                f"no foot is on the floor from {start / fps:.1f} to {stop / fps:.1f} s: a robot that stands free cannot "
                "play that; keep both feet on the floor (legs 'stand'), or do without balance (balance 'off')"
            )


def _hand_over(planted: np.ndarray) -> None:
    """Put both feet down at two adjacent frames that stand on different feet."""
    switch = np.flatnonzero(~(planted[:-1] & planted[1:]).any(axis=1))
    both = planted[switch] | planted[switch + 1]
    planted[switch], planted[switch + 1] = both, both
