"""Feet that skate and bodies that float throughout a clip: no foothold can be read off them."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.rule import JOINTS, ContactRule, lowest_over_time, speed_of
from robot_retarget.human.recognition.recognise import Recognition, leg_length

FEET = ("l_ankle", "r_ankle", "l_toe", "r_toe")


@dataclass(frozen=True)
class FootingRule:
    """Thresholds; lengths in leg lengths, speeds in leg lengths per second."""

    stance: ContactRule = JOINTS
    """A low part of a foot skates while it is faster than what starts a stance."""
    high: float = 0.15
    """A body whose lowest point is higher than this above the floor floats."""
    most: float = 0.75
    """Share of the frames from which on a clip skates or floats throughout [-]."""
    shortest: float = 1.0
    """Shorter clips are not judged [s]."""


def footing(recognition: Recognition, positions: Floats, fps: float, rule: FootingRule) -> tuple[str, ...]:
    """Return sentences about feet that skate, and about a body that floats, throughout.

    Args:
        positions: (T, J, 3) of the joints, z up [m].
    """
    if len(positions) < rule.shortest * fps:
        return ()
    leg = leg_length(recognition, positions)
    x = recognition.place(positions) / leg
    return (*_skating(recognition, x, fps, leg, rule), *(_floating(x, leg, rule) or _climbing(x, fps, leg, rule)))


def _skating(recognition: Recognition, x: Floats, fps: float, leg: float, rule: FootingRule) -> tuple[str, ...]:
    at, stance = recognition.keypoints.index, rule.stance
    feet = x[:, [at(k) for k in FEET if k in recognition.marks]]
    low = feet[:, :, 2] - stance.floor_height(feet[:, :, 2], axis=0) < stance.enter_height
    slowest = np.where(low, speed_of(feet[:, :, :2], fps, stance), np.inf).min(axis=1)
    seen = np.isfinite(slowest)
    skates = slowest[seen] > stance.enter_speed
    if seen.mean() < 0.5 or skates.mean() < rule.most:
        return ()
    speed, when = float(np.median(slowest[seen])) * leg, np.flatnonzero(seen)[skates][[0, -1]] / fps
    return (
        f"The feet skate in {skates.mean():.0%} of the time ({when[0]:.2f}–{when[1]:.2f} s), at {speed:.1f} m/s where they are "
        "lowest and no foothold is found: a motion in place, or one whose path does not fit its legs.",
    )


def _climbing(x: Floats, fps: float, leg: float, rule: FootingRule) -> tuple[str, ...]:
    """Return a sentence about ground that does not stay at one height: steps, a climb, or drift of the capture."""
    ground = lowest_over_time(x[:, :, 2], fps)
    change = float(np.ptp(ground))
    if change < rule.high:
        return ()
    when = sorted((int(ground.argmin()), int(ground.argmax())))
    return (
        f"The lowest points of the body change their height by {leg * change:.2f} m from {when[0] / fps:.1f} to {when[1] / fps:.1f} s "
        "(steps, a climb, or drift of the capture): without a scene or --terrain auto the robot's floor is level and follows them.",
    )


def _floating(x: Floats, leg: float, rule: FootingRule) -> tuple[str, ...]:
    lowest = x[:, :, 2].min(axis=1)
    high = lowest - rule.stance.floor_height(lowest) > rule.high
    if high.mean() < rule.most:
        return ()
    return (
        f"The body floats in {high.mean():.0%} of the time, up to {leg * np.ptp(lowest):.2f} m over its lowest point: "
        "the floor follows its lowest points over time.",
    )
