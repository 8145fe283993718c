"""When the human's feet stand: heel and toe apart, as the source says, or by speed and height, in units of the leg."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from robot_retarget.arrays import Bools, Floats
from robot_retarget.describe.match import Match


@dataclass(frozen=True)
class StanceRule:
    """What counts as standing; speeds in leg lengths per second, heights in leg lengths over the foot's lowest."""

    enter_speed: float = 0.3
    leave_speed: float = 0.4
    enter_height: float = 0.08
    leave_height: float = 0.10
    shortest: float = 0.15
    """A stance or a swing shorter than this is taken for noise [s]."""


def contact_schedule(
    x: Floats, match: Match, fps: float, contacts: Bools | None = None, rule: StanceRule | None = None
) -> dict[str, np.ndarray]:
    """Per foot (`l`, `r`) a boolean (T, 2): whether the toe, and whether the heel, stands at each frame.

    Contacts that the source says are taken as they are, but for those too short to be true. Else a part stands from when
    it is slow and low until it is fast or high again. The ankle speaks for the heel.

    Args:
        x: (T, K, 3) the human's keypoints over level ground [m].
        contacts: (T, 4) of left heel, left toe, right heel, right toe (`Motion.contacts`).
    """
    chosen, found = rule or StanceRule(), {}
    if contacts is not None:
        feet = {
            side: contacts[:, [2 * k + 1, 2 * k]] for k, side in enumerate("lr") if f"{side}_ankle" in match.keypoints
        }
        return {side: _lasting(said, fps, chosen) for side, said in feet.items()}
    for part, column in (("toe", 0), ("ankle", 1)):
        present = [f"{s}_{part}" for s in "lr" if f"{s}_{part}" in match.keypoints]
        if not present:
            continue
        points = x[:, [match.index(k) for k in present]] / match.human_leg
        floor = np.quantile(points[:, :, 2], 0.02)
        for k, keypoint in enumerate(present):
            standing = _standing(points[:, k], points[:, k, 2] - floor, fps, chosen)
            found.setdefault(keypoint[0], np.zeros((len(x), 2), dtype=bool))[:, column] = standing
    return found


def _standing(points: Floats, height: Floats, fps: float, rule: StanceRule) -> np.ndarray:
    speed = _speed(points, fps)
    enter = (speed < rule.enter_speed) & (height < rule.enter_height)
    stay = (speed < rule.leave_speed) & (height < rule.leave_height)
    return _lasting(_hysteresis(enter, stay), fps, rule)


def _lasting(standing: Bools, fps: float, rule: StanceRule) -> Bools:
    """What stands or swings (T, …) for long enough to be true."""
    width = 2 * int(rule.shortest * fps / 2) + 1
    size = (width, *(1,) * (standing.ndim - 1))
    return median_filter(standing.astype(np.uint8), size, mode="nearest").astype(bool)


def _speed(points: Floats, fps: float) -> Floats:
    """(T,) mean over a tenth of a second, so that the frame rate does not matter."""
    if len(points) < 2:
        return np.zeros(len(points))
    step = np.linalg.norm(np.diff(points, axis=0), axis=1) * fps
    step = np.concatenate([step[:1], (step[:-1] + step[1:]) / 2, step[-1:]])
    return uniform_filter1d(step, max(1, round(0.1 * fps)), mode="nearest")


def _hysteresis(enter: np.ndarray, stay: np.ndarray) -> np.ndarray:
    """True from each frame of `enter` on, both ways in time, for as long as `stay` holds."""
    runs = np.cumsum(np.concatenate([[True], stay[1:] != stay[:-1]]))
    entered = np.zeros(runs[-1] + 1, dtype=bool)
    entered[runs[enter]] = True
    return stay & entered[runs]


def intervals(flags: np.ndarray) -> list[tuple[int, int]]:
    """The runs of True as (first, last + 1)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
