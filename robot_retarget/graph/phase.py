"""Phases of a solution that change targets: a motion without balance, the coarse path of a clip, a balanced playback, its stands."""

from dataclasses import dataclass

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.graph.role import Form, Role
from robot_retarget.graph.track import Track


class Phase:
    """A phase; it leaves the targets of most kinds unchanged."""

    def of(self, track: Track) -> Track:
        """Return the targets of a kind without targets of its own in this phase."""
        return track


class UnbalancedPhase(Phase):
    """No balance follows: the motion is judged by its likeness alone."""


class CoarsePhase(Phase):
    """The coarse path is sought; no measures of the robot are known."""


@dataclass(frozen=True, eq=False)
class SolvedPhase(Phase):
    """The coarse path is known; the kind receives its measures (T, E)."""

    fixed: int = 0
    """Number of frames at the start that keep their targets."""
    unreached: Bools | None = None
    """(T,) frames at which no pose meets the hard edges together, once that is known."""


@dataclass(frozen=True, eq=False)
class PlaybackPhase(Phase):
    """K frames of a balanced playback, which starts and ends in a stand; the kind receives the measures (K, E) in them.

    Symbolic costs fade out towards the stands.
    """

    share: Floats
    """(K, 1) share of the human's motion, 0 in the stands."""
    soles: Floats
    """(K, F · 4 · 3) places of the sole corners [m]."""
    grip: Floats
    """(K, F · 4 · 3) π of these."""
    standing: float
    """π of joints at their standing angles [1/rad²]."""
    upright: float
    """π of the pelvis in a stand."""
    height: float
    """π of the height of the pelvis, over the squared leg."""

    def of(self, track: Track) -> Track:
        """Return the targets with the priorities multiplied by the share."""
        fades = (track.role, track.kind.form) == (Role.COST, Form.SYMBOLIC)
        return track.weighed(self.share) if fades else track


class StandPhase(PlaybackPhase):
    """One frame of a balanced stand; the kind receives the measures (1, E) in the standing pose."""
