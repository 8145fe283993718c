"""How much time a motion needs: stretched where a joint, the zero moment point or a shift of weight cannot follow."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.robot import Robot


@dataclass(frozen=True)
class Pacing:
    """When and by how much to slow down."""

    slowest: float = 4.0
    """At most, over the whole clip."""
    speed: float = 0.85
    """Share of a joint's greatest speed that is used."""
    edge: float = 0.3
    """The zero moment point stays this share of the way from the edge of the support to its middle inside."""
    excess: float = 1e-3
    """The planned centre of mass may leave its polygon by this [m]."""
    shift: float = 1.25
    """Factor, a round, on frames that stand on all feet near a shift of weight that comes too late ..."""
    step: float = 1.04
    """... and on the other frames near it."""
    near: float = 0.5
    """How near, in time of the playback [s]."""
    most: float = 1.5
    """Factor on any frame, a round."""
    blend: float = 0.07
    """Time over which the pace changes, in time of the clip [s]."""
    shifts: int = 24
    """Rounds of shifting weight, which are cheap ..."""
    rounds: int = 4
    """... and rounds of the whole motion."""


@dataclass(frozen=True)
class Score:
    """K frames of a playback, on the clip's time and on the stands' before and after."""

    at: Floats
    """(K,) frame of the clip."""
    share: Floats
    """(K,) how much of the clip's pose: 0 in the stands, 1 within the clip."""
    planted: np.ndarray
    """(K, F)."""
    fps: float


def stretched(stretch: Floats, score: Score, needs: Floats, pacing: Pacing) -> Floats:
    """Frame durations (T − 1,) multiplied by what the frames of the playback (K,) need, blended over time and capped."""
    left = np.minimum(score.at.astype(int), len(stretch) - 1)
    inside = score.share >= 1
    factor = np.ones(len(stretch))
    np.maximum.at(factor, left[inside], needs[inside])
    width = pacing.blend * score.fps
    wide = maximum_filter1d(factor, 2 * round(2 * width) + 1, mode="nearest")
    slower = stretch * np.exp(gaussian_filter1d(np.log(wide), width, mode="nearest"))
    return 1 + (slower - 1) * min(1.0, (pacing.slowest - 1) / max(slower.mean() - 1, 1e-9))


def shift_needs(late: np.ndarray, score: Score, pacing: Pacing) -> Floats:
    """(K,) factors near the frames at which the centre of mass comes too `late`."""
    around = maximum_filter1d(late.astype(np.int8), 2 * round(pacing.near * score.fps) + 1) > 0
    everywhere = score.planted.all(axis=1)
    return np.where(around, np.where(everywhere, pacing.shift, pacing.step), 1.0)


def motion_needs(robot: Robot, qpos: Floats, inside: Floats, fps: float, pacing: Pacing) -> Floats:
    """(K,) factors by which joints are too fast, or the accelerations that move the zero moment point too great.

    Args:
        inside: (K,) how far the zero moment point is inside the support: 1 in its middle, 0 on the edge.
    """
    speed = np.abs(np.diff(qpos[:, robot.qpos_index], axis=0)) * fps / (pacing.speed * robot.max_speed)
    ratio = np.concatenate([speed.max(axis=1), [0.0]])
    return np.clip(np.maximum(ratio, 1 + pacing.edge - inside), 1.0, pacing.most)
