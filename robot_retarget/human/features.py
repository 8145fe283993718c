"""Features of a human motion: the input of every kind of edge."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.constants import g

from robot_retarget.base.arrays import Bools, Floats, Ints, intervals, leftward
from robot_retarget.base.errors import BalanceError, MotionError
from robot_retarget.contact.rule import (
    JOINTS,
    contact_schedule,
    high_feet,
    in_the_air,
    lowest_over_time,
    on_soles,
    without_flicker,
)
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.segments import (
    FEET,
    carrying_joint,
    facing,
    heading,
    matrices_of,
    segment_constants,
    untwisted,
    visible_segments,
)
from robot_retarget.human.touches import Surroundings, surroundings_of

FALL = 0.4
"""Flights of five captures have the acceleration g within 0.22 of it; the pelvis is not the centre of mass [-]."""
FEWEST = 2
"""Frames of the shortest flight: 2, whose mean acceleration needs a frame to either side."""

# Activity of the feet: in place, stepping, flight, or supported by an object that the robot does not have.

IN_PLACE, STEPPING, FLIGHT, SUPPORTED = "in place", "stepping", "flight", "supported"


@dataclass(frozen=True)
class ActivityRule:
    """Thresholds; lengths in leg lengths of the human."""

    brief: float = 0.1
    """Activities with a smaller share of the time are ignored [-]: single steps in place, brief support. Half and double
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


# The floor under the human, and its drift in captures without a fixed reference.

DRIFT = 0.1
"""A floor whose height varies by less is level [leg lengths]. Half changes the contacts of 1 % of the labelled clips' frames,
double none."""


def floor_under(positions: Floats, match: Match, fps: float) -> Floats:
    """Return the height (T,) of the floor [m]; 0 where the source knows its floor.

    The floor is the lowest foot of the clip. Heights of inertial captures drift: there the floor of each frame is the lowest
    point of the body within `WINDOW` to either side, smoothed. This also removes steps and stairs.

    Args:
        positions: (T, K, 3) keypoints [m].
        match: keypoints that human and robot share.
        fps: frames per second [1/s].
    """
    if match.recognition.ankle_height is not None:
        return np.zeros(len(positions))
    z, lowest = positions[:, :, 2], lowest_over_time(positions[:, :, 2], fps)
    feet = [k for k, name in enumerate(match.keypoints) if name.endswith(("ankle", "toe"))]
    level = JOINTS.floor_height(z[:, feet].min(axis=1)) if feet else z.min()
    return np.full_like(lowest, level) if np.ptp(lowest) < DRIFT * match.human_leg else lowest


# The constants of one performer: how joints become keypoints over a floor, and axes of segments.
#
# A clip fits them to all its frames, a stream to its calibration frames; both then read frames by the same `Calibration`.


@dataclass(frozen=True, eq=False)
class Calibration:
    """Constants of one performer, matched with one robot."""

    match: Match
    weights: Floats
    """(K, J) shares of the joints in the keypoints."""
    floor: float
    """Height of the floor in the source [m]."""
    segment_names: tuple[str, ...]
    constants: Floats
    """(S, 3, 3) from the measured axes of each segment to its forward, left and up."""
    joints: Ints
    """(S,) joint that turns each segment; empty where the source has no rotations."""

    @cached_property
    def _legs(self) -> tuple[Ints, Ints]:
        """The columns of feet on whole legs among the segments, and of hip, knee and ankle (F, 3) among the keypoints."""
        known = self.match.keypoints
        if self.match.recognition.segments:
            return np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
        legs = {name: [f"{name[0]}_{k}" for k in ("hip", "knee", "ankle")] for name in FEET}
        whole = [name for name in FEET if name in self.segment_names and set(legs[name]) <= set(known)]
        columns = [[known.index(k) for k in legs[name]] for name in whole]
        own = [self.segment_names.index(name) for name in whole]
        return np.array(own, dtype=np.int64), np.array(columns, dtype=np.int64)

    def named(self, axes: Floats) -> dict[str, Floats]:
        """Return axes (T, S, 3, 3) by the name of the segment."""
        return {name: axes[:, k] for k, name in enumerate(self.segment_names)}

    def axes(self, x: Floats, rotations: Floats | None) -> Floats:
        """Return the axes (T, S, 3, 3) of every segment.

        Args:
            x: (T, K, 3) keypoints [m].
            rotations: (T, J, 4) of the joints, w x y z, or None.
        """
        if not self.segment_names:
            return np.zeros((len(x), 0, 3, 3))
        if len(self.joints) and rotations is not None:
            measured = matrices_of(rotations.take(self.joints, axis=1))
        else:
            visible = visible_segments(self.match.named(x))
            measured = np.stack([visible[name] for name in self.segment_names], axis=1)
        axes = measured @ self.constants
        feet, legs = self._legs
        if len(feet):
            axes[:, feet] = untwisted(axes.take(feet, axis=1), x.take(legs, axis=1))
        return axes


def calibrate(motion: Motion, match: Match, x: Floats, floor: Floats, contacts: dict[str, Bools]) -> Calibration:
    """Fit the constants of a performer to a motion.

    Args:
        x: (T, K, 3) keypoints over level ground [m].
        floor: (T,) its height in the source [m].
    """
    constants = segment_constants(motion, match, x, floor, contacts)
    turning = () if motion.rotations is None else tuple(carrying_joint(motion, match, name) for name in constants)
    return Calibration(
        match,
        match.weights(len(motion.skeleton)),
        float(np.median(floor)),
        tuple(constants),
        np.array(list(constants.values())).reshape(-1, 3, 3),
        np.array(turning, dtype=np.int64),
    )


@dataclass(frozen=True, eq=False)
class HumanFeatures:
    """Features of T frames over level ground, at the K keypoints that human and robot share."""

    positions: Floats
    """(T, K, 3) keypoints, the floor under them at z = 0 [m]."""
    axes: Floats
    """(T, S, 3, 3) forward, left and up of every segment as columns."""
    contacts: dict[str, Bools]
    """The contact schedule: per foot (`l`, `r`) (T, 2), whether toe and heel stand."""
    supported: Bools
    """(T,) whether something else than the feet holds the body up; a stream does not look."""
    flying: Bools
    """(T,) whether both feet are in the air; a stream does not look."""
    calibration: Calibration
    """Constants of the performer."""
    fps: float
    ankle_height: float = 0.0
    """Height of the lowest ankle above the floor while it stands [m]."""
    falls: Floats | None = None
    """(T, 2) in flight, the height of the pelvis over the line from take-off to landing, and that of free fall; 0 elsewhere [m].
    None if it is not examined, as in a stream."""
    around: Surroundings | None = None
    """The bodies around, where the human touches them, and the ground under the feet; None without a scene."""

    def __len__(self) -> int:
        return len(self.positions)

    @cached_property
    def segments(self) -> dict[str, Floats]:
        """Axes (T, 3, 3) by the name of the segment."""
        return self.calibration.named(self.axes)

    @cached_property
    def facing(self) -> Floats:
        """(T, 3, 3) orientation of the whole body."""
        return facing(self.segments, len(self))

    @cached_property
    def heading(self) -> Floats:
        """(T, 2) unit vectors along the floor in which the body faces."""
        return heading(self.facing)

    @property
    def level(self) -> Floats:
        """(T, 3, 3) forward along the heading, left, and up."""
        axes = np.zeros((len(self), 3, 3))
        axes[:, :2, 0], axes[:, :2, 1], axes[:, 2, 2] = self.heading, leftward(self.heading), 1.0
        return axes

    @property
    def activity(self) -> Activity:
        """Activity of the feet in these frames."""
        return activity_of(self.supported, self.flying, self.contacts, self.fps)

    def at(self, frames: slice | np.ndarray) -> "HumanFeatures":
        """Return the features of some of the frames."""
        return replace(
            self,
            positions=self.positions[frames],
            axes=self.axes[frames],
            contacts={foot: stands[frames] for foot, stands in self.contacts.items()},
            supported=self.supported[frames],
            flying=self.flying[frames],
            falls=None if self.falls is None else self.falls[frames],
            around=None if self.around is None else self.around.at(frames),
        )


def features_of(motion: Motion, match: Match) -> HumanFeatures:
    """Return the features of a motion; a part of a clip uses the whole clip for its constants.

    Raises:
        MotionError: the file has further frames that are no poses, and no part of it was taken.
    """
    if motion.scrambled:
        raise MotionError(motion.scrambled, motion.source)
    clip, fps, rule = motion.clip, motion.fps, ActivityRule()
    x = match.human_positions(clip)
    floor = floor_under(x, match, fps) if clip.scene is None else np.zeros(len(x))
    x = x - floor[:, None, None] * [0.0, 0.0, 1.0]
    around = None if clip.scene is None else surroundings_of(clip, match, x)
    level = x if around is None else around.levelled(x, match)
    contacts = contact_schedule(match.named(level), match.human_leg, fps, clip.contacts)
    calibration = calibrate(clip, match, x, floor, contacts)
    axes = calibration.axes(x, clip.rotations)
    segments = calibration.named(axes)
    contacts = {foot: without_flicker(stands, fps) for foot, stands in on_soles(contacts, segments).items()}
    whole = HumanFeatures(
        x,
        axes,
        contacts,
        is_supported(level, match, rule),
        is_flying(level, match, fps),
        calibration,
        fps,
        _ankle_height(level, match),
        falls_of(x, match, in_the_air(match.named(level), match.human_leg, fps, clip.contacts), fps),
        None if around is None else around.without_stances(contacts),
    )
    return whole.at(motion.span)


def falls_of(x: Floats, match: Match, airborne: Bools, fps: float) -> Floats:
    """Return (T, 2) how far the pelvis is over the line from take-off to landing, and a body in free fall; 0 out of flights [m].

    With z the height of the pelvis, a and b the frames before and after a flight and τ the time since a,

        own = z(τ) − z(a) − (z(b) − z(a)) τ/T,    fall = g τ (T − τ) / 2,    T the time from a to b.

    A flight is a time in the air in which the human falls: frames at its ends are left out until the parabola that fits the
    pelvis has an acceleration within `FALL` of g. The path of a robot is exact and falls as it does: own = fall.

    Args:
        x: (T, K, 3) keypoints over level ground [m].
        match: keypoints that human and robot share.
        airborne: (T,) whether no foot is on the ground.
        fps: frames per second [1/s].
    """
    falls = np.zeros((len(x), 2))
    if "pelvis" not in match.keypoints:
        return falls
    z = x[:, match.index("pelvis"), 2]
    for start, stop in intervals(airborne):
        while start > 0 and stop < len(z) and stop - start >= FEWEST:
            time = np.arange(stop - start + 2) / fps
            own = z[start - 1 : stop + 1]
            if abs(2 * np.polyfit(time, own, 2)[0] + g) < FALL * g:
                fall = g * time * (time[-1] - time) / 2
                exact = match.recognition.ankle_height is not None  # a robot, whose hop may have less than g
                falls[start - 1 : stop + 1, 0] = fall if exact else own - np.interp(time, time[[0, -1]], own[[0, -1]])
                falls[start - 1 : stop + 1, 1] = fall
                break
            start, stop = start + 1, stop - 1
    return falls


def _ankle_height(x: Floats, match: Match) -> float:
    """Return the known height of the ankles of a body that stands, else that of the lowest one; 0 without ankles [m]."""
    if match.recognition.ankle_height is not None:
        return match.recognition.ankle_height
    ankles = [match.index(k) for k in ("l_ankle", "r_ankle") if k in match.keypoints]
    return float(JOINTS.floor_height(x[:, ankles, 2].min(axis=1))) if ankles else 0.0
