"""What a solver returns: the trajectory, and how well each frame was solved."""

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.trajectory import Trajectory

JUMP = 15.0
"""A hinge that turns faster is reported: 0.5 rad between frames at 30 frames a second [rad/s]; servos turn at up to 10."""


class Status(Enum):
    """Why the solver stopped at a frame; the value is the sentence for a person."""

    CONVERGED = "the step fell below the tolerance"
    OUT_OF_ITERATIONS = "the iterations ran out; the pose is usable, not final"
    BLOCKED = "no admissible step was found; the previous pose is kept"


@dataclass(frozen=True)
class Solution:
    """A trajectory that can judge itself: how each frame ended, how much it misses, and where."""

    trajectory: Trajectory
    status: tuple[Status, ...]
    cost: Floats
    """(T,) weighted sum of squared edge errors."""
    errors: Floats
    """(T, E) of the posture edges, |d − δ|/τ."""
    labels: tuple[str, ...]
    """(E,) names of the posture edges."""
    iterations: Ints
    """(T,) Gauss–Newton steps."""
    timings: dict[str, float] = field(default_factory=dict)
    """Seconds spent, by stage."""
    native: bool = False
    """Whether machine code served, not CasADi's virtual machine; the results are the same."""

    @cached_property
    def stress(self) -> Floats:
        """(T,) mean of |d − δ|/τ over the posture edges."""
        return self.errors.mean(axis=1) if self.errors.size else np.zeros(len(self.cost))

    def unsolved(self) -> list[int]:
        """Frames that did not converge."""
        return [t for t, s in enumerate(self.status) if s is not Status.CONVERGED]

    def largest_step(self) -> float:
        """The largest change of one hinge between two frames [rad]; a jump is seen here."""
        hinges = self.trajectory.qpos[:, -len(self.trajectory.joint_names) :]
        return float(np.abs(np.diff(hinges, axis=0)).max(initial=0.0))

    def jumps(self) -> list[tuple[str, int, float]]:
        """Changes of a hinge faster than `JUMP`, largest first: joint, the frame it ends at, step [rad]."""
        names = self.trajectory.joint_names
        steps = np.diff(self.trajectory.qpos[:, -len(names) :], axis=0)
        frames, joints = np.nonzero(np.abs(steps) > JUMP / self.trajectory.fps)
        order = np.argsort(-np.abs(steps[frames, joints]))
        return [(names[joints[k]], int(frames[k]) + 1, float(steps[frames[k], joints[k]])) for k in order]

    def worst_edges(self, count: int = 8) -> list[tuple[str, float, int]]:
        """The posture edges with the largest mean error: name, mean error, the frame where it is largest."""
        mean = self.errors.mean(axis=0)
        order = np.argsort(-mean)[:count]
        return [(self.labels[e], float(mean[e]), int(self.errors[:, e].argmax())) for e in order]
