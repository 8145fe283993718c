"""Features of a human motion: the input of every kind of edge."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.constants import g

from robot_retarget.base.arrays import Bools, Floats, Ints, intervals, leftward
from robot_retarget.base.errors import MotionError
from robot_retarget.contact.record import ContactRecord
from robot_retarget.contact.rule import (
    JOINTS,
    contact_schedule,
    lowest_over_time,
    on_soles,
    settled,
)
from robot_retarget.human.activity import Activity, ActivityRule, activity_of, is_flying, is_supported, not_standing
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.segments import (
    FEET,
    carrying_joint,
    facing,
    matrices_of,
    segment_constants,
    untwisted,
    visible_segments,
)
from robot_retarget.human.touches import Surroundings, surroundings_of
from robot_retarget.human.up_axis import centre_of_mass

FALL = 0.4
"""Flights of five captures have the acceleration g within 0.22 of it by the pelvis; that of the centre of mass is nearer [-]."""
SHORTEST_FLIGHT = 2
"""Frames of the shortest flight: 2, whose mean acceleration needs a frame to either side."""

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


def calibrate(motion: Motion, match: Match, x: Floats, floor: Floats, contacts: ContactRecord) -> Calibration:
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
    contacts: ContactRecord
    """Which feet are on the ground."""
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
    """(T, 2) in flight, the height of the centre of mass over the line from take-off to landing, and that of free fall; 0 elsewhere [m].
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
        """(T, 2) unit vectors along the floor across the hips (`Match.heading`)."""
        angle = self.calibration.match.heading(self.positions)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

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

    @property
    def not_standing(self) -> str:
        """What of these frames no robot plays that stands on its own feet; empty without any."""
        return not_standing(self.activity, self.positions, self.calibration.match, self.contacts)

    def at(self, frames: slice | np.ndarray) -> "HumanFeatures":
        """Return the features of some of the frames."""
        return replace(
            self,
            positions=self.positions[frames],
            axes=self.axes[frames],
            contacts=self.contacts[frames],
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
    placed, keypoints = match.recognition.place(clip.positions), match.recognition.keypoints
    x = placed[:, [keypoints.index(name) for name in match.keypoints]]
    floor = floor_under(x, match, fps) if clip.scene is None else np.zeros(len(x))
    x = x - floor[:, None, None] * [0.0, 0.0, 1.0]
    around = None if clip.scene is None else surroundings_of(clip, match, x)
    level = x if around is None else around.levelled(x, match)
    contacts = contact_schedule(match.named(level), match.human_leg, fps, clip.contacts)
    calibration = calibrate(clip, match, x, floor, contacts)
    axes = calibration.axes(x, clip.rotations)
    segments, mass = calibration.named(axes), centre_of_mass(match.recognition, placed)
    contacts = settled(on_soles(contacts, segments), fps)
    whole = HumanFeatures(
        x,
        axes,
        contacts,
        is_supported(level, match, rule),
        is_flying(level, match, fps),
        calibration,
        fps,
        _ankle_height(level, match),
        falls_of(mass[:, 2] - floor, match, contacts.flying, fps),
        None if around is None else around.without_stances(contacts),
    )
    return whole.at(motion.span)


def falls_of(z: Floats, match: Match, airborne: Bools, fps: float) -> Floats:
    """Return (T, 2) how far the centre of mass is over the line from take-off to landing, and in free fall; 0 out of flights [m].

    With z its height, a and b the frames before and after a flight and τ the time since a,

        own = z(τ) − z(a) − (z(b) − z(a)) τ/T,    fall = g τ (T − τ) / 2,    T the time from a to b.

    A flight is a time in the air in which the human falls: frames at its ends are left out until the parabola that fits z
    has an acceleration within `FALL` of g. The path of a robot is exact and falls as it does: own = fall.

    Args:
        z: (T,) over level ground [m].
        match: keypoints that human and robot share.
        airborne: (T,) whether no foot is on the ground.
        fps: frames per second [1/s].
    """
    falls = np.zeros((len(z), 2))
    for start, stop in intervals(airborne) if "pelvis" in match.keypoints else ():
        while start > 0 and stop < len(z) and stop - start >= SHORTEST_FLIGHT:
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
