"""How much time a motion needs: stretched where a joint, the zero moment point or a shift of weight cannot follow."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.motion.stance import intervals
from robot_retarget.robot import Robot

SPARE = 0.3
"""Of a joint's torque: where holding still takes more than all but this, slowing down does not help."""


@dataclass(frozen=True)
class Pacing:
    """When and by how much to slow down."""

    slowest: float = 4.0
    """At most, over the whole clip."""
    speed: float = 0.85
    """Share of a joint's greatest speed that is used."""
    torque: float = 0.9
    """Share of what the torque–speed line leaves."""
    edge: float = 0.3
    """The zero moment point stays this share of the way from the edge of the support to its middle inside."""
    friction: float = 0.35
    """Coefficient of the floor that may be needed: what turns quickly over feet that stand makes them slide."""
    excess: float = 1e-3
    """The planned centre of mass may leave its polygon by this [m]."""
    swing: float = 0.8
    """A foot is in the air for so long at least [s]: a leg that is thrown forward throws the body back."""
    shift: float = 1.25
    """Factor, a round, on frames that stand on all feet near a shift of weight that comes too late."""
    near: float = 0.5
    """How near, in time of the playback [s]."""
    slack: float = 1.2
    """What needs no more time than this is let pass: a servo may be asked for a little more for a moment."""
    most: float = 1.5
    """Factor on any frame, a round."""
    blend: float = 0.07
    """Time over which the pace changes, in time of the clip [s]."""
    shifts: int = 24
    """Rounds of shifting weight, which are cheap ..."""
    rounds: int = 4
    """... and rounds of the whole motion."""


@dataclass(frozen=True)
class Timeline:
    """K frames of a playback, on the clip's time and on the stands' before and after."""

    at: Floats
    """(K,) frame of the clip."""
    share: Floats
    """(K,) how much of the clip's pose: 0 in the stands, 1 within the clip."""
    planted: np.ndarray
    """(K, F)."""
    fps: float


def unhurried(planted: np.ndarray, fps: float, pacing: Pacing) -> Floats:
    """Frame durations (T − 1,) at which no swing of a foot, planted (T, F), is shorter than it should be."""
    factor = np.ones(len(planted) - 1)
    for foot in planted.T:
        for start, stop in intervals(~foot):
            part = slice(max(start - 1, 0), stop)
            factor[part] = np.maximum(factor[part], pacing.swing * fps / (stop - start + 1))
    return _capped(factor, pacing)


def stretched(stretch: Floats, timeline: Timeline, needs: Floats, pacing: Pacing) -> Floats:
    """Frame durations (T − 1,) multiplied by what the frames of the playback (K,) need, blended over time and capped."""
    left = np.minimum(timeline.at.astype(int), len(stretch) - 1)
    inside = timeline.share >= 1
    factor = np.ones(len(stretch))
    np.maximum.at(factor, left[inside], needs[inside])
    width = pacing.blend * timeline.fps
    wide = maximum_filter1d(factor, 2 * round(2 * width) + 1, mode="nearest")
    slower = stretch * np.exp(gaussian_filter1d(np.log(wide), width, mode="nearest"))
    return _capped(slower, pacing)


def _capped(stretch: Floats, pacing: Pacing) -> Floats:
    """Frame durations that are on average no longer than the slowest pace allows, in proportion."""
    return 1 + (stretch - 1) * min(1.0, (pacing.slowest - 1) / max(stretch.mean() - 1, 1e-9))


def shift_needs(late: np.ndarray, timeline: Timeline, pacing: Pacing) -> Floats:
    """(K,) factors near the frames at which the centre of mass comes too `late`."""
    around = maximum_filter1d(late.astype(np.int8), 2 * round(pacing.near * timeline.fps) + 1) > 0
    everywhere = timeline.planted.all(axis=1)
    return np.where(around & everywhere, pacing.shift, 1.0)


def motion_needs(
    robot: Robot,
    qpos: Floats,
    loads: tuple[Floats, Floats],
    inside: Floats,
    friction: Floats,
    fps: float,
    pacing: Pacing,
) -> Floats:
    """(K,) factors by which joints are too fast or too heavily loaded, or soles near tipping over an edge or sliding.

    Args:
        loads: (K, n) torques in motion and at rest (`dynamics.joint_torques`) [N m].
        inside: (K,) how far the zero moment point is inside the support: 1 in its middle, 0 on the edge.
        friction: (K,) coefficient that the soles need; forces go by the square of the pace.
    """
    share = np.diff(qpos[:, robot.qpos_index], axis=0, append=qpos[-1:, robot.qpos_index]) * fps / robot.max_speed
    moving, resting = (load / robot.max_torque for load in loads)
    # A motor gives τ while turning at ω as one at rest gives τ + τ_max ω/ω_max: the torque–speed line.
    asked, held = np.abs(moving + share), np.abs(resting)
    overload = np.maximum(asked - held, 0.0) / np.maximum(pacing.torque - held, SPARE)
    worst = np.maximum(np.abs(share) / pacing.speed, overload ** (2 / 3)).max(axis=1)
    soles = np.maximum(1 + pacing.edge - inside, np.sqrt(friction / pacing.friction))
    return np.clip(np.maximum(worst, soles), 1.0, pacing.most)
