"""Feet that skate or float throughout a clip: nothing there can be held on to, and that is said."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.motion.recognise import Recognition
from robot_retarget.motion.stature import leg_length

FEET = ("l_ankle", "r_ankle", "l_toe", "r_toe")


@dataclass(frozen=True)
class FootingRule:
    """What is no footing; lengths in leg lengths."""

    low: float = 0.08
    """A part of a foot that is so near to its lowest may stand ..."""
    slow: float = 0.3
    """... and does while it is slower than this [1/s], over ..."""
    over: float = 0.1
    """... this time [s]."""
    running: float = 3.0
    """Who is faster than this is not looked at: a runner's stance is too short to be seen [1/s]."""
    high: float = 0.15
    """Nothing of the body is this near to the floor: it floats."""
    most: float = 0.75
    """In so large a share of the frames, it does so throughout."""
    shortest: float = 1.0
    """Shorter clips are not looked at [s]."""


def footing(recognition: Recognition, positions: Floats, fps: float, rule: FootingRule) -> tuple[str, ...]:
    """Sentences about feet that skate, and about a body that floats, throughout.

    Args:
        positions: (T, J, 3) of the joints, z up [m].
    """
    if len(positions) < rule.shortest * fps:
        return ()
    leg = leg_length(recognition, positions)
    x = recognition.place(positions) / leg
    return (*_skating(recognition, x, fps, leg, rule), *_floating(x, leg, rule))


def _skating(recognition: Recognition, x: Floats, fps: float, leg: float, rule: FootingRule) -> tuple[str, ...]:
    at = recognition.keypoints.index
    feet = x[:, [at(k) for k in FEET if k in recognition.marks]]
    low = feet[:, :, 2] - np.quantile(feet[:, :, 2], 0.02, axis=0) < rule.low
    slowest = np.where(low, _speed(feet, fps, rule), np.inf).min(axis=1)
    seen = np.isfinite(slowest) & (_speed(x[:, [at("pelvis")]], fps, rule)[:, 0] < rule.running)
    skates = slowest[seen] > rule.slow
    if seen.mean() < 0.5 or skates.mean() < rule.most:
        return ()
    speed, when = float(np.median(slowest[seen])) * leg, np.flatnonzero(seen)[skates][[0, -1]] / fps
    return (
        f"The feet skate in {skates.mean():.0%} of the time ({when[0]:.2f}–{when[1]:.2f} s), at {speed:.1f} m/s where they are "
        "lowest: no foothold is seen there; a motion in place, or one whose path does not fit its legs.",
    )


def _floating(x: Floats, leg: float, rule: FootingRule) -> tuple[str, ...]:
    lowest = x[:, :, 2].min(axis=1)
    high = lowest - np.quantile(lowest, 0.02) > rule.high
    if high.mean() < rule.most:
        return ()
    return (
        f"The body floats in {high.mean():.0%} of the time, up to {leg * np.ptp(lowest):.2f} m over where it is lowest: "
        "the floor is taken to be where it comes down to from moment to moment.",
    )


def _speed(points: Floats, fps: float, rule: FootingRule) -> Floats:
    """(T, P) over the floor, of points (T, P, 3) [1/s]."""
    speed = np.linalg.norm(np.gradient(points[:, :, :2], 1 / fps, axis=0), axis=2)
    return uniform_filter1d(speed, max(1, round(rule.over * fps)), axis=0, mode="nearest")
