"""Activity of the feet: in place, stepping, flight, or supported by an object that the robot does not have."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from robot_retarget.arrays import Floats
from robot_retarget.errors import BalanceError
from robot_retarget.human.contacts import contact_schedule
from robot_retarget.human.ground import WINDOW, grounded
from robot_retarget.human.match import Match
from robot_retarget.human.skeleton import Motion
from robot_retarget.human.stance import StanceRule, intervals

IN_PLACE, STEPPING, FLIGHT, SUPPORTED = "in place", "stepping", "flight", "supported"


@dataclass(frozen=True)
class ActivityRule:
    """Thresholds; lengths in leg lengths of the human."""

    brief: float = 0.1
    """Activities with a smaller share of the time are ignored [-]: single steps in place, brief support."""
    high: float = 0.12
    """A flight has both feet higher than this, for longer than the shortest stance."""
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


def activity_of(motion: Motion, match: Match, rule: ActivityRule | None = None) -> Activity:
    """Classify the activity from feet and pelvis; a match without legs is in place.

    Args:
        motion: the human.
        match: keypoints that human and robot share.
        rule: thresholds.
    """
    chosen, fps = rule or ActivityRule(), motion.fps
    if not {"pelvis", "l_ankle", "r_ankle"} <= set(match.keypoints):
        return Activity(IN_PLACE)
    clip, span = motion.clip, motion.span
    x = grounded(match.human_positions(clip), match, fps) / match.human_leg
    held = _held(x, match, chosen)[span]
    if held.mean() > chosen.brief:
        return _longest(SUPPORTED, held, fps)
    flying = _flying(x, match, fps, chosen)[span]
    if any((stop - start) / fps > StanceRule().shortest for start, stop in intervals(flying)):
        return _longest(FLIGHT, flying, fps)
    schedule = contact_schedule(x * match.human_leg, match, fps, clip.contacts)
    planted = [foot[span].any(axis=1) for foot in schedule.values()]
    return Activity(IN_PLACE if np.logical_and.reduce(planted).mean() >= 1 - chosen.brief else STEPPING)


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


def _held(x: Floats, match: Match, rule: ActivityRule) -> np.ndarray:
    """(T,) whether the pelvis is low and far from over the feet."""
    pelvis, ankles = x[:, match.index("pelvis")], x[:, [match.index(k) for k in ("l_ankle", "r_ankle")]]
    beside = np.linalg.norm(pelvis[:, :2] - ankles.mean(axis=1)[:, :2], axis=1)
    return (pelvis[:, 2] < rule.low * -StanceRule().floor_height(-pelvis[:, 2])) & (beside > rule.seat_offset)


def _flying(x: Floats, match: Match, fps: float, rule: ActivityRule) -> np.ndarray:
    """(T,) whether both feet are high; on tiptoe the toes stay low."""
    parts = [match.index(k) for k in ("l_ankle", "r_ankle", "l_toe", "r_toe") if k in match.keypoints]
    lowest = (x[:, parts, 2] - StanceRule().floor_height(x[:, parts, 2], axis=0)).min(axis=1)
    return lowest - minimum_filter1d(lowest, 2 * round(WINDOW * fps) + 1, mode="nearest") > rule.high


def _longest(kind: str, flags: np.ndarray, fps: float) -> Activity:
    start, stop = max(intervals(flags), key=lambda span: span[1] - span[0])
    return Activity(kind, start / fps, stop / fps)
