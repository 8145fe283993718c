"""Features of a human motion: the input of every kind of edge."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.contact.feet import contact_schedule, on_soles
from robot_retarget.contact.rule import JOINTS, without_flicker
from robot_retarget.human.activity import Activity, ActivityRule, activity_of, is_flying, is_supported
from robot_retarget.human.calibration import Calibration, calibrate
from robot_retarget.human.ground import floor_under
from robot_retarget.human.match import Match
from robot_retarget.human.motion import Motion
from robot_retarget.human.segments import facing, heading
from robot_retarget.human.touches import Surroundings, surroundings_of


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
            around=None if self.around is None else self.around.at(frames),
        )


def features_of(motion: Motion, match: Match) -> HumanFeatures:
    """Return the features of a motion; a part of a clip uses the whole clip for its constants."""
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
        None if around is None else around.without_stances(contacts),
    )
    return whole.at(motion.span)


def _ankle_height(x: Floats, match: Match) -> float:
    """Return the known height of the ankles of a body that stands, else that of the lowest one; 0 without ankles [m]."""
    if match.recognition.ankle_height is not None:
        return match.recognition.ankle_height
    ankles = [match.index(k) for k in ("l_ankle", "r_ankle") if k in match.keypoints]
    return float(JOINTS.floor_height(x[:, ankles, 2].min(axis=1))) if ankles else 0.0
