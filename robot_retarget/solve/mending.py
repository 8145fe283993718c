"""Links that a whole clip has inside each other at a frame, or leads through each other between two frames."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.solve.between import Between, on_the_way
from robot_retarget.solve.frame import OVERLAP, FrameSolver, Pose
from robot_retarget.solve.quadratic import Pull

LESSENED = 0.5
"""A passage that is still deeper than this share of what it was at the last look is given up [-]."""
ROUNDS = 3
"""So often the frames around a passage are sought anew: what makes way at one side may meet another link."""


def beside(poses: list[Pose], t: int) -> list[Floats]:
    """The configurations before and after a frame."""
    return [poses[k].qpos for k in (t - 1, t + 1) if 0 <= k < len(poses)]


class Passages:
    """Where links pass through each other between a frame t and the next, as far as they can make way for each other.

    A link that is drawn right through another one only bends all else, so what does not lessen soon is given up.
    """

    def __init__(self, solver: FrameSolver):
        self.solver = solver
        self.depth: dict[int, float] = {}
        """When last looked at [m]; of those that were given up, for good."""
        self.met: set[int] = set()
        self.lost: set[int] = set()

    def look(self, poses: list[Pose], frames: Iterable[int]) -> set[int]:
        """Those of some frames after which links pass now; what was found earlier stays known."""
        deepest = {t: self.solver.depth_between(poses[t].qpos, poses[t + 1].qpos) for t in frames if t not in self.lost}
        now = {t: deep for t, deep in deepest.items() if deep > OVERLAP}
        self.lost |= {t for t, deep in now.items() if deep > LESSENED * self.depth.get(t, np.inf)}
        self.depth |= now
        self.met = self.met.union(now) - self.lost
        return now.keys() - self.lost

    def between(self, poses: list[Pose], t: int) -> tuple[Between, ...]:
        """Where links are kept apart between a frame and its neighbours."""
        neighbours = (poses[k].qpos for k in (t - 1, t + 1) if min(k, t) in self.met)
        return tuple(way for q in neighbours for way in on_the_way(self.solver.robot, q, poses[t].qpos))


@dataclass(frozen=True)
class Mender:
    """What the frames t of a window are asked for, the first of which are `fixed`."""

    solver: FrameSolver
    wished: list[tuple[Floats, ...]]
    pulls: Sequence[Pull]
    passages: Passages
    fixed: int
    fps: float

    def mended(self, poses: list[Pose]) -> list[Pose]:
        """The poses with links apart, at frames and between them, as far as that is found."""
        poses = list(poses)
        self._at_frames(poses)
        self._between(poses)
        return poses

    def _at_frames(self, poses: list[Pose]) -> None:
        """A full descent for frames whose links are inside each other; a second one without the pull, from the frame
        before, for those that the smooth path draws through each other; at last a pose on the way from the frame before.
        """
        left = self._overlapping(poses, range(self.fixed, len(poses)))
        for t in left:
            poses[t] = self._sought(poses, t)
        left = self._overlapping(poses, left)
        for t in left:
            box = self.solver.reachable(beside(poses, t), 1 / self.fps)
            poses[t] = self.solver.descend(poses[max(t - 1, 0)].qpos, self.wished[t], box=box)
        for t in self._overlapping(poses, left):
            if t > 0:
                poses[t] = self.solver.held_back(poses[t - 1].qpos, poses[t], self.wished[t])

    def _between(self, poses: list[Pose]) -> None:
        """Where links still pass through each other, the frames to both sides make way; those that did in vain come back."""
        last, lost = len(poses) - 1, set(self.passages.lost)
        passing = self.passages.look(poses, range(max(self.fixed - 1, 0), last))
        self._seek_again(poses, self._around(self.passages.lost - lost))
        for _ in range(ROUNDS):
            frames = self._around(passing)
            self._seek_again(poses, frames)
            passing = self.passages.look(poses, {k for t in frames for k in (t - 1, t) if 0 <= k < last})

    def _seek_again(self, poses: list[Pose], frames: list[int]) -> None:
        """A full descent for some frames, kept where links are not inside each other."""
        for t in frames:
            found = self._sought(poses, t)
            if not self.solver.overlapping(found.qpos):
                poses[t] = found

    def _around(self, passing: set[int]) -> list[int]:
        """The frames before and after passages that may change."""
        return sorted({t + k for t in passing for k in (0, 1) if t + k >= self.fixed})

    def _sought(self, poses: list[Pose], t: int) -> Pose:
        box, ways = self.solver.reachable(beside(poses, t), 1 / self.fps), self.passages.between(poses, t)
        return self.solver.descend(poses[t].qpos, self.wished[t], pull=self.pulls[t], box=box, between=ways)

    def _overlapping(self, poses: list[Pose], frames: Iterable[int]) -> list[int]:
        """Those of some frames whose links are inside each other."""
        return [t for t in frames if self.solver.overlapping(poses[t].qpos)]
