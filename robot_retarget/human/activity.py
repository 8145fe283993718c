"""Activity of the human's feet (in place, stepping, flight, supported), and motions that a robot cannot play standing."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, intervals, unit
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import JOINTS, high_feet
from robot_retarget.human.match import Match

IN_PLACE, STEPPING, FLIGHT, SUPPORTED = "in place", "stepping", "flight", "supported"


@dataclass(frozen=True)
class ActivityRule:
    """Thresholds; lengths in leg lengths of the human."""

    brief: float = 0.1
    """Support, steps and lying with a smaller share of the time are ignored [-]; a flight has its own limit. Half and double
    change none of 13 clips."""
    low: float = 0.62
    """A supported human has the pelvis lower than this share of its usual height [-] (half and double change none of 13
    clips) ..."""
    seat_offset: float = 0.3
    """... and farther from the middle of the feet along the floor than this: on a chair, or on hands. Half finds the
    same in 21 clips; double loses the chair."""


@dataclass(frozen=True)
class Activity:
    """Activity of a human, and its longest interval."""

    kind: str
    """`in place`, `stepping`, `flight` or `supported`."""
    since: float = 0.0
    until: float = 0.0
    """`since` and `until`: the longest flight or support [s]; 0 for other activities."""


def activity_of(supported: Bools, flying: Bools, contacts: ContactRecord, fps: float) -> Activity:
    """Classify the activity; a body without two feet is in place.

    Args:
        supported: (T,) whether another contact than the feet carries the body.
        flying: (T,) whether both feet are in the air.
        contacts: feet on the ground over time.
        fps: frames per second [1/s].
    """
    brief = ActivityRule().brief
    if len(contacts.feet) < 2:
        return Activity(IN_PLACE)
    if supported.mean() > brief:
        return _longest(SUPPORTED, supported, fps)
    if any((stop - start) / fps > JOINTS.flight for start, stop in intervals(flying)):
        return _longest(FLIGHT, flying, fps)
    return Activity(IN_PLACE if contacts.planted.all(axis=1).mean() >= 1 - brief else STEPPING)


def is_supported(x: Floats, match: Match, rule: ActivityRule) -> Bools:
    """Return (T,) whether the pelvis of keypoints (T, K, 3) [m] is low, and horizontally far from the middle of the ankles."""
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


CHEST_UPRIGHT = 0.35
"""A chest that is higher over the pelvis than this share of their distance is upright enough to stand [-]: 20° over level."""
SPIN = np.pi
"""A larger turn without a new foothold is a spin [rad]: hips of human and robot turn by a quarter turn to each side."""


def not_standing(activity: Activity, x: Floats, match: Match, contacts: ContactRecord) -> str:
    """Return the reason for which a robot cannot play a motion standing: lying, support, flight or a spin; an empty text without one.

    Args:
        activity: activity of the feet.
        x: (T, K, 3) keypoints over level ground [m].
        match: keypoints that human and robot share.
        contacts: feet on the ground over time.
    """
    since = f"longest from {activity.since:.1f} to {activity.until:.1f} s"
    if _lying(x, match).mean() > ActivityRule().brief:
        return "the human lies or crawls"
    if activity.kind == SUPPORTED:
        return f"a seat, hands or the floor hold the human up, {since}"
    if activity.kind == FLIGHT:
        return f"the human leaves the floor, {since}"
    turn = _spin(match.heading(x), contacts)
    return f"the human spins by {np.degrees(turn):.0f}° on one foothold" if turn > SPIN else ""


def _lying(x: Floats, match: Match) -> Bools:
    """Return (T,) whether the pelvis is low and the trunk is about level or upside down."""
    if not {"pelvis", "chest"} <= set(match.keypoints):
        return np.zeros(len(x), bool)
    pelvis = x[:, match.index("pelvis")]
    trunk = unit(x[:, match.index("chest")] - pelvis)
    low = pelvis[:, 2] < ActivityRule().low * -JOINTS.floor_height(-pelvis[:, 2])
    return low & (trunk[:, 2] < CHEST_UPRIGHT)


def _spin(heading: Floats, contacts: ContactRecord) -> float:
    """Return the largest turn between two consecutive landings of feet [rad]; a turn in flight counts."""
    turned = np.unwrap(heading)
    starts = {start for foot in contacts.planted.T for start, _ in intervals(foot)} | {0, len(turned)}
    edges = sorted(starts)
    return max((float(np.ptp(turned[a:b])) for a, b in pairwise(edges) if b > a), default=0.0)
