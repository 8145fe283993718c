"""Activity of the feet: in place, stepping, flight, or supported by an object that the robot does not have."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, intervals
from robot_retarget.base.errors import BalanceError
from robot_retarget.contact.feet import high_feet
from robot_retarget.contact.rule import JOINTS
from robot_retarget.human.match import Match

IN_PLACE, STEPPING, FLIGHT, SUPPORTED = "in place", "stepping", "flight", "supported"


@dataclass(frozen=True)
class ActivityRule:
    """Thresholds; lengths in leg lengths of the human."""

    brief: float = 0.1
    """Activities with a smaller share of the time are ignored [-]: single steps in place, brief support."""
    low: float = 0.62
    """A supported human has the pelvis lower than this share of its usual height [-] ..."""
    seat_offset: float = 0.3
    """... and farther from the middle of the feet along the floor than this: on a chair, or on hands."""


@dataclass(frozen=True)
class Activity:
    """Activity of a human, and its longest interval."""

    kind: str
    """`in place`, `stepping`, `flight` or `supported`."""
    since: float = 0.0
    until: float = 0.0
    """Longest flight or support [s]."""


def activity_of(supported: Bools, flying: Bools, contacts: dict[str, Bools], fps: float) -> Activity:
    """Classify the activity; a body without two feet is in place.

    Args:
        supported: (T,) whether something else than the feet holds the body up.
        flying: (T,) whether both feet are in the air.
    """
    brief = ActivityRule().brief
    if len(contacts) < 2:
        return Activity(IN_PLACE)
    if supported.mean() > brief:
        return _longest(SUPPORTED, supported, fps)
    if any((stop - start) / fps > JOINTS.flight for start, stop in intervals(flying)):
        return _longest(FLIGHT, flying, fps)
    planted = [foot.any(axis=1) for foot in contacts.values()]
    return Activity(IN_PLACE if np.logical_and.reduce(planted).mean() >= 1 - brief else STEPPING)


def require_own_feet(activity: Activity) -> None:
    """Refuse a motion that needs a support the robot does not have.

    Raises:
        BalanceError: the human is supported.
    """
    if activity.kind == SUPPORTED:
        raise BalanceError(
            f"something that the robot does not have holds the human up (a chair, hands on the floor), longest from "
            f"{activity.since:.1f} to {activity.until:.1f} s: a robot that stands free cannot play that; keep both feet on "
            "the floor (legs 'stand'), or do without balance (balance 'off')"
        )


def is_supported(x: Floats, match: Match, rule: ActivityRule) -> Bools:
    """Return (T,) whether the pelvis of keypoints (T, K, 3) [m] is low and far from over the feet."""
    if not {"pelvis", "l_ankle", "r_ankle"} <= set(match.keypoints):
        return np.zeros(len(x), dtype=bool)
    x = x / match.human_leg
    pelvis, ankles = x[:, match.index("pelvis")], x[:, [match.index(k) for k in ("l_ankle", "r_ankle")]]
    beside = np.linalg.norm(pelvis[:, :2] - ankles.mean(axis=1)[:, :2], axis=1)
    return (pelvis[:, 2] < rule.low * -JOINTS.floor_height(-pelvis[:, 2])) & (beside > rule.seat_offset)


def is_flying(x: Floats, match: Match, fps: float) -> Bools:
    """Return (T,) whether both feet of keypoints (T, K, 3) [m] are in the air."""
    parts = [match.index(k) for k in ("l_ankle", "r_ankle", "l_toe", "r_toe") if k in match.keypoints]
    return high_feet(x[:, parts, 2] / match.human_leg, fps) if parts else np.zeros(len(x), dtype=bool)


def _longest(kind: str, flags: np.ndarray, fps: float) -> Activity:
    start, stop = max(intervals(flags), key=lambda span: span[1] - span[0])
    return Activity(kind, start / fps, stop / fps)
