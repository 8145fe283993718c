"""The result of a solver: the trajectory, and the quality of each frame and each edge."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.graph import EdgeError
from robot_retarget.graph.track import Status
from robot_retarget.trajectory import Trajectory

JUMP = 15.0
"""A faster hinge is reported: 0.5 rad between frames at 30 frames a second [rad/s]; servos reach up to 10."""


@dataclass(frozen=True)
class UnmetEdge:
    """A hard edge and the frames at which it misses its interval."""

    kind: str
    name: str
    frames: tuple[int, ...]
    """The frames that miss it."""
    frame: int
    """The frame of the largest miss."""
    measured: float
    """The measure there [m]."""
    lower: float
    upper: float
    """The interval there [m]."""
    reasons: tuple[str, ...]
    """Limits that are active there; may be empty."""
    by_user: bool = False
    """Whether a user added the edge."""

    @property
    def sentence(self) -> str:
        """Return the finding as a sentence."""
        asked = f"{self.lower:.3g} … {self.upper:.3g} m"
        if self.lower == self.upper or np.isinf(self.upper):
            asked = f"{self.lower:.3g} m" + (" or more" if self.lower < self.upper else "")
        elif np.isinf(self.lower):
            asked = f"{self.upper:.3g} m or less"
        first, last, count = self.frames[0], self.frames[-1], len(self.frames)
        when = f"frame {first}" if count == 1 else f"{count} frames of {first} … {last}"
        why = "; ".join(self.reasons) or "other edges oppose it"
        return f"hard edge {self.name}: {self.measured:.3f} m at frame {self.frame} instead of {asked}, unmet in {when}: {why}"


def unmet_of_user(unmet: Iterable[UnmetEdge]) -> list[str]:
    """Return a sentence for each edge of a user among the unmet ones."""
    return list(dict.fromkeys(edge.sentence for edge in unmet if edge.by_user))


@dataclass(frozen=True, eq=False)
class Solution:
    """A trajectory with its quality: the end of each frame, the cost of each edge, and the place of that cost."""

    trajectory: Trajectory
    graph: RobotGraph
    status: tuple[Status, ...]
    cost: Floats
    """(T,) the minimised cost at the returned configurations: Σ over kinds of `stress`."""
    stress: Mapping[str, Floats]
    """Per kind (T,) its part of the cost."""
    measured: Mapping[str, Floats]
    """Per kind with edges (T, E) the measures [m] or [rad]."""
    iterations: Ints
    """(T,) steps of the quadratic program."""
    timings: dict[str, float] = field(default_factory=dict)
    """Seconds spent, by stage."""
    native: bool = False
    """Whether machine code evaluated the problem, not CasADi's virtual machine; the results are the same."""
    unmet: tuple[UnmetEdge, ...] = ()
    """The hard edges that miss their interval, with the limits that prevent it."""

    def errors(self, kind: str) -> Floats:
        """Return (T, E) signed errors (d − y)/scale of a kind's edges [-]."""
        return self.graph.kinds[kind].errors(self.measured[kind])

    def __repr__(self) -> str:
        return f"<Solution {self.trajectory!r}: {self.ended}, cost {self.cost.mean():.4g} a frame>"

    @property
    def ended(self) -> str:
        """How the frames ended, with their numbers, in one line."""
        counted = Counter(status.name.replace("_", " ").lower() for status in self.status)
        return ", ".join(f"{n} {name}" for name, n in counted.items())

    @property
    def posture_error(self) -> Floats:
        """Return (T,) the mean of |d − δ|/τ over the posture edges."""
        return np.abs(self.errors("posture")).mean(axis=1) if "posture" in self.measured else np.zeros(len(self.cost))

    def largest_step(self) -> float:
        """Return the largest change of one hinge between two frames [rad]; it shows a jump."""
        hinges = self.trajectory.angles
        return float(np.abs(np.diff(hinges, axis=0)).max(initial=0.0))

    def jumps(self) -> list[tuple[str, int, float]]:
        """Return changes of a hinge faster than `JUMP`, largest first: joint, the frame at its end, step [rad]."""
        names = self.trajectory.joint_names
        steps = np.diff(self.trajectory.angles, axis=0)
        frames, joints = np.nonzero(np.abs(steps) > JUMP / self.trajectory.fps)
        order = np.argsort(-np.abs(steps[frames, joints]))
        return [(names[joints[k]], int(frames[k]) + 1, float(steps[frames[k], joints[k]])) for k in order]

    def costliest(self, count: int = 8) -> list[EdgeError]:
        """Return the edges with the largest cost over the clip, each at its worst frame."""
        return self.graph.costliest(self.measured, count)

    def edge_stress(self, kind: str) -> Floats:
        """(T, E) π ϱ(e) of a kind's edges."""
        return self.graph.kinds[kind].stress(self.measured[kind])
