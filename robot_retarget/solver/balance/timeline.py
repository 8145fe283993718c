"""The time that a motion needs: it slows down if a joint, the zero moment point or a shift of weight needs more."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from robot_retarget.base.arrays import Floats, intervals
from robot_retarget.robot import Robot

SPARE = 0.3
"""Least usable share of a joint's torque: a joint that holds still with more than the rest gains nothing from slowing
down."""


@dataclass(frozen=True)
class Pacing:
    """The conditions and the amount of slowing down."""

    slowest: float = 4.0
    """Largest slowdown, averaged over the whole clip."""
    speed: float = 0.85
    """Usable share of a joint's largest speed."""
    torque: float = 0.9
    """Usable share of the torque on the torque–speed line."""
    edge: float = 0.3
    """Least distance of the zero moment point from the edge of the support, as a share of the distance from edge to
    middle."""
    friction: float = 0.35
    """Largest friction coefficient used: fast turns over standing feet make them slide."""
    excess: float = 1e-3
    """The planned centre of mass may leave its polygon by this [m]."""
    swing: float = 0.8
    """Least duration of a swing [s]: a leg that swings forward pushes the body back."""
    transfer: float = 0.2
    """Least duration of a shift of weight, with all feet on the floor [s]: on a foot that lands a little tilted, the body sways."""
    shift: float = 1.25
    """Factor per round on frames with all feet on the floor, near a shift of weight that comes too late."""
    near: float = 0.5
    """Largest time distance from that shift, in time of the playback [s]."""
    slack: float = 1.2
    """Needs up to this factor are ignored: a servo can exceed its limits slightly for a moment."""
    most: float = 1.5
    """Largest factor on any frame per round."""
    blend: float = 0.07
    """Time over which the pace changes, in time of the playback [s]."""
    shifts: int = 24
    """Number of rounds of shifting weight, which are cheap ..."""
    rounds: int = 4
    """... and rounds of the whole motion."""


@dataclass(frozen=True)
class Timeline:
    """K frames of a playback, on the clip's time and on the stands' before and after."""

    at: Floats
    """(K,) frame of the clip."""
    share: Floats
    """(K,) share of the clip's pose: 0 in the stands, 1 within the clip."""
    planted: np.ndarray
    """(K, F) feet on the floor."""
    fps: float


def least_durations(planted: np.ndarray, fps: float, pacing: Pacing) -> Floats:
    """Return the durations of frames that give every swing of a foot, and every shift of weight between two, its least duration.

    Args:
        planted: (T, F) feet on the floor.
        fps: frames per second of the clip [1/s].
        pacing: the least durations, and the largest slowdown.

    Returns:
        (T − 1,) durations over 1/fps [-].
    """
    factor = np.ones(len(planted) - 1)
    swings = [(span, pacing.swing, 1) for foot in planted.T for span in intervals(~foot)]
    shifts = [(span, pacing.transfer, 0) for span in intervals(np.asarray(planted.all(axis=1)))]
    for (start, stop), least, more in swings + shifts:
        part = slice(max(start - 1, 0), stop)
        factor[part] = np.maximum(factor[part], least * fps / (stop - start + more))
    return _capped(factor, pacing)


def stretched(stretch: Floats, timeline: Timeline, needs: Floats, pacing: Pacing) -> Floats:
    """Return durations of frames multiplied by needed factors, blended over time and capped.

    Args:
        stretch: (T − 1,) durations of the clip's frames over their own [-].
        timeline: K frames of the playback.
        needs: (K,) factors by which the frames must last longer [-].
        pacing: the blend and the largest slowdown.
    """
    inside, width = timeline.share >= 1, pacing.blend * timeline.fps
    wide = maximum_filter1d(np.where(inside, needs, 1.0), 2 * round(2 * width) + 1, mode="nearest")
    slower = np.exp(gaussian_filter1d(np.log(wide), width, mode="nearest"))[inside]
    at, last = timeline.at[inside], len(stretch) - 1
    factor = np.interp(np.arange(len(stretch)) + 0.5, at, slower)
    # The first and the last pose of the clip may last longer than a frame.
    np.maximum.at(factor, np.minimum(at.astype(int), last), slower)
    return _capped(stretch * factor, pacing)


def _capped(stretch: Floats, pacing: Pacing) -> Floats:
    """Return frame durations scaled so that their mean does not exceed the slowest pace."""
    return 1 + (stretch - 1) * min(1.0, (pacing.slowest - 1) / max(stretch.mean() - 1, 1e-9))


def shift_needs(late: np.ndarray, timeline: Timeline, pacing: Pacing) -> Floats:
    """Return the factors of frames with all feet on the floor near a late shift of weight.

    Args:
        late: (K,) whether the centre of mass is outside its polygon.
        timeline: K frames of the playback.
        pacing: the factor, and the time around a late frame.

    Returns:
        (K,) factors, 1 elsewhere [-].
    """
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
    """Return (K,) factors for joints beyond speed or load, and for soles near tipping over an edge or sliding.

    Args:
        loads: (K, n) torques in motion and at rest (`dynamics.joint_torques`) [N m].
        inside: (K,) position of the zero moment point in the support: 1 in its middle, 0 on the edge.
        friction: (K,) coefficient that the soles need; forces scale with the square of the pace.
    """
    share = np.diff(qpos[:, robot.qpos_index], axis=0, append=qpos[-1:, robot.qpos_index]) * fps / robot.max_speed
    moving, resting = (load / robot.max_torque for load in loads)
    # A motor gives τ while turning at ω as one at rest gives τ + τ_max ω/ω_max: the torque–speed line.
    asked, held = np.abs(moving + share), np.abs(resting)
    overload = np.maximum(asked - held, 0.0) / np.maximum(pacing.torque - held, SPARE)
    worst = np.maximum(np.abs(share) / pacing.speed, overload ** (2 / 3)).max(axis=1)
    soles = np.maximum(1 + pacing.edge - inside, np.sqrt(friction / pacing.friction))
    return np.clip(np.maximum(worst, soles), 1.0, pacing.most)
