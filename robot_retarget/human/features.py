"""Features of a human motion: the input of every kind of edge."""

from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.human.contacts import contact_schedule
from robot_retarget.human.ground import grounded
from robot_retarget.human.match import Match
from robot_retarget.human.normalisation import normalised_distances
from robot_retarget.human.segments import facing, human_frames
from robot_retarget.human.skeleton import Motion
from robot_retarget.human.stance import StanceRule


@dataclass(frozen=True, eq=False)
class HumanFeatures:
    """Features of T frames over level ground, at the K keypoints that human and robot share."""

    positions: Floats
    """(T, K, 3) keypoints, the floor under them at z = 0 [m]."""
    segments: dict[str, Floats]
    """Per segment (T, 3, 3): its forward, left and up as columns."""
    facing: Floats
    """(T, 3, 3) orientation of the whole body."""
    contacts: dict[str, np.ndarray]
    """The contact schedule: per foot (`l`, `r`) (T, 2), whether toe and heel stand."""
    closeness: Floats
    """(T, K, K) D̄ = ‖x_u − x_v‖/τ_uv, distances over the length of the path between [Mucherino2017]."""
    fps: float
    ankle_height: float = 0.0
    """Height of the lowest ankle above the floor while it stands [m]."""

    def __len__(self) -> int:
        return len(self.positions)

    def at(self, frames: slice | np.ndarray) -> "HumanFeatures":
        """Return the features of some of the frames."""
        return replace(
            self,
            positions=self.positions[frames],
            segments={name: turns[frames] for name, turns in self.segments.items()},
            facing=self.facing[frames],
            contacts={foot: stands[frames] for foot, stands in self.contacts.items()},
            closeness=self.closeness[frames],
        )


def features_of(motion: Motion, match: Match) -> HumanFeatures:
    """Return the features of a motion; a part of a clip uses the whole clip for its constants.

    Args:
        motion: the human.
        match: keypoints that human and robot share.
    """
    clip, span = motion.clip, motion.span
    x = grounded(match.human_positions(clip), match, clip.fps)
    segments = human_frames(clip, match)
    schedule = contact_schedule(x, match, clip.fps, clip.contacts)
    return HumanFeatures(
        x[span],
        {name: turns[span] for name, turns in segments.items()},
        np.broadcast_to(facing(segments), (len(x), 3, 3))[span],
        {foot: stands[span] for foot, stands in schedule.items()},
        normalised_distances(x[span], match.parents, match.human_bones),
        clip.fps,
        _ankle_height(x, match),
    )


def _ankle_height(x: Floats, match: Match) -> float:
    """Return the known height of the ankles of a body that stands, else that of the lowest one; 0 without ankles [m]."""
    if match.recognition.ankle_height is not None:
        return match.recognition.ankle_height
    ankles = [match.index(k) for k in ("l_ankle", "r_ankle") if k in match.keypoints]
    return float(StanceRule().floor_height(x[:, ankles, 2].min(axis=1))) if ankles else 0.0
