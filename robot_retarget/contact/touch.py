"""Touches: of a hand and another part of the same body, and of a part and a body around it, for a clip and for a stream.

Two parts touch by the closeness of their keypoints, their distance over the path of bones between them: 0 together, 1
stretched. A part touches a body by the distance of its keypoint from the surface, less a thickness of flesh.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Bools, Floats, intervals
from robot_retarget.base.keypoints import ARM
from robot_retarget.contact.rule import JOINTS, without_flicker

REACH = {"head": 0.22, "hand": 0.13, "knee": 0.14}
"""A hand touches these parts within this closeness [-] (with half, 43 of 5075 frames and pairs of a clap differ; with
double, 626; measured) ..."""
OTHER = 0.1
"""... and the other parts within this one: half and double find the same in two claps and a bow."""
FAINT = 0.02
"""A pair of at most this strength does not touch [-]: a hand that swings past a hip. Half and double move 38 and 328 of
5800 frames and pairs in the clip of a bow."""
TOUCHED = ("head", "l_hip", "r_hip", "l_knee", "r_knee", "pelvis")
"""Parts that a hand touches, in addition to the other hand. Other pairs, as an elbow and a hand, pass each other closely."""
BRIEF = 0.2
"""A hand passes a part that it touches for less [s]: 5 to 12 frames of a hand that swings past the hip in a walk; a clap stays
longer within its closeness."""
SLACK = 0.04
"""A robot keeps a touch whose closeness exceeds the human's by at most this [-]: half keeps as many of the 177 touching
frames of a boxing clip on the G1 and the OP3, double 1 % more."""
ARRIVED = 0.02
"""A touch of a body begins and ends where the part is no farther than this beyond its median distance [leg lengths]."""


def touch_reach(a: str, b: str, other: float = OTHER) -> float:
    """Return the closeness within which two keypoints touch [-]; 0 for parts that cannot.

    Args:
        a: a keypoint.
        b: the other keypoint.
        other: of a hand and a part that is no head, hand or knee.
    """
    for hand, part in ((a, b), (b, a)):
        own_arm = part[:2] == hand[:2] and part[2:] in ARM
        if hand.endswith("_hand") and not own_arm:
            return REACH.get(part.split("_")[-1], other)
    return 0.0


def touch_strength(closeness: Floats, reach: Floats | float) -> Floats:
    """Return the strength  max(exp(−(D̄ / reach)⁸) − faint, 0)  of touches, 0 … 1.

    Args:
        closeness: (…, P) D̄, distances over the paths between [-].
        reach: (P,) of the pairs [-].
    """
    near = closeness / reach
    near *= near
    near *= near
    return np.maximum(np.exp(-near * near) - FAINT, 0.0)


def gradual(strength: Bools | Floats, frames: int) -> Floats:
    """Return strengths (T, C) that rise before a touch and fall after it, within some frames: the maximum around, then its mean."""
    width = 2 * frames + 1
    most = maximum_filter1d(strength.astype(float), width, axis=0, mode="nearest")
    return np.clip(uniform_filter1d(most, width, axis=0, mode="nearest"), 0.0, 1.0)  # a running sum may end at −1e-17


def hand_pairs(keypoints: Collection[str]) -> list[tuple[str, str]]:
    """Return the pairs of keypoints that touch where a hand touches: the hands, and a hand and a part of `TOUCHED`."""
    pairs = [("l_hand", "r_hand"), *((f"{side}_hand", part) for side in "lr" for part in TOUCHED)]
    return [(hand, part) for hand, part in pairs if {hand, part} <= set(keypoints)]


@dataclass(frozen=True, eq=False)
class HandTouches:
    """Touches of P pairs over T frames, of a human and of the robot that follows."""

    human: Bools
    """(T, P) whether the human's parts touch."""
    kept: Bools
    """(T, P) whether the human's touch and the robot's are as close."""
    false: Bools
    """(T, P) whether the robot's alone touch."""

    @property
    def share(self) -> float | None:
        """Share of the human's touches that the robot keeps; None without any."""
        return float(self.kept.sum() / self.human.sum()) if self.human.any() else None


def hand_touches(pairs: Sequence[tuple[str, str]], human: Floats, robot: Floats, fps: float) -> HandTouches:
    """Detect which touches of the hands a robot keeps; passing ones do not count (`BRIEF`).

    Args:
        pairs: P of `hand_pairs`.
        human: (T, P) closeness of its pairs [-].
        robot: (T, P) closeness [-].
        fps: frames per second [1/s].
    """
    near = np.array([touch_reach(*pair) for pair in pairs])
    touch = lasting(human < near, round(BRIEF * fps))
    return HandTouches(touch, touch & (robot < human + SLACK), (robot < near) & (human > near + SLACK))


def lasting(flags: Bools, frames: int) -> Bools:
    """Return flags (T, P) without runs shorter than a number of frames."""
    found = flags.copy()
    for pair in range(flags.shape[1]):
        for start, stop in intervals(flags[:, pair]):
            found[start:stop, pair] &= stop - start >= frames
    return found


def body_touches(away: Floats, leg: float, fps: float) -> Bools:
    """Detect the touches of parts and bodies, from the whole clip.

    The approach and the departure, in which a part is farther than its median by more than `ARRIVED`, are left out.

    Args:
        away: (T, C) distances of parts from surfaces, less their thickness [m].
        leg: length of the leg [m].
        fps: frames per second [1/s].
    """
    held = without_flicker(away < 0, fps)
    found = np.zeros_like(held)
    for pair in range(held.shape[1]):
        for start, stop in intervals(held[:, pair]):
            own = away[start:stop, pair]
            there = start + np.flatnonzero(own <= np.median(own) + ARRIVED * leg)
            found[there[0] : there[-1] + 1, pair] = True
    return found


class CausalBodyTouches:
    """`body_touches` of a stream.

    A touch begins where a part is within reach and comes no nearer, and ends where it leaves by `ARRIVED` the least distance
    that it had.
    """

    def __init__(self, count: int, leg: float):
        """Start with `count` pairs apart; `leg` [m]."""
        self.held: Bools = np.zeros(count, dtype=bool)
        self._near = ARRIVED * leg
        self._since, self._away, self._least = np.full((3, count), np.inf)

    def step(self, away: Floats, seconds: float) -> Bools:
        """Update which pairs touch, and return those that begin to (C,).

        Args:
            away: (C,) distances of parts from surfaces, less their thickness [m].
            seconds: since the frame before [s].
        """
        shortest = JOINTS.shortest
        nearing = (self._away - away) / seconds > self._near / shortest
        touch = np.where(self.held, (away < 0) & (away < self._least + self._near), (away < 0) & ~nearing)
        self._since += seconds
        changed = (touch != self.held) & (self._since >= shortest)
        self.held = self.held ^ changed
        self._since[changed], self._away = 0.0, away
        began = changed & self.held
        self._least = np.where(began, away, np.minimum(self._least, away))
        return began
