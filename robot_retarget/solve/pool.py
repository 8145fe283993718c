"""The poses found so far at the moments of a sketch, and the cheapest path through them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.describe.edges import Edges
from robot_retarget.robot.kinematics import difference
from robot_retarget.solve.frame import Box, FrameSolver, Pose
from robot_retarget.solve.solution import Status
from robot_retarget.solve.speeds import within_speeds
from robot_retarget.solve.starts import drawn_limbs, lying, ways


@dataclass(frozen=True)
class Sketching:
    """How widely to search."""

    rate: float = 10.0
    """Frames per second of the sketch [1/s]."""
    every: float = 1.0
    """Time between the moments at which ways are sought [s]."""
    iterations: int = 10
    """At most, per frame that is followed: the fine solution comes later."""
    tolerance: float = 1e-3
    """As `Options.tolerance`, for the same reason."""
    ways: int = 3
    """At most, per moment ..."""
    worth: float = 1.3
    """... if they cost less than so many times the least."""
    same: float = 0.15
    """Poses whose hinges all lie nearer than this are one [rad]."""
    caught: float = 2.0
    """Ways are sought, too, where a path costs so many times what it does where they were."""
    change: float = 0.5
    """Cost of a change of pose between frames of the sketch [1/rad²] ..."""
    hurry: float = 30.0
    """... and on top of what hinges turn beyond their speeds: more than a way across costs on its way, if there is one."""
    mixes: int = 2
    """Rounds at most in which limbs are exchanged between the path and cheaper poses ..."""
    dear: float = 0.05
    """... where the path costs by this share more than the cheapest pose of the moment ..."""
    donors: int = 2
    """... with so many of the cheapest."""


class Pool:
    """The poses found so far, per frame of the sketch."""

    def __init__(
        self,
        solver: FrameSolver,
        edges: Edges,
        held: np.ndarray,
        frames: np.ndarray,
        fps: float,
        sketching: Sketching,
    ):
        self.solver, self.edges, self.held, self.sketching = solver, edges, held, sketching
        self.frames, self.times = frames, frames / fps
        self.poses: list[list[Pose]] = [[] for _ in frames]
        self.hinges, self.first = solver.robot.qpos_index, 0

    def set_out(self, qpos: Floats) -> None:
        """Begin with a pose that is not in question, and follow it."""
        pose = Pose(qpos, Status.CONVERGED, 0.0, 0)
        self.poses[0].append(pose)
        self.first = 1
        self._follow(pose, 0, range(1, len(self.frames)))

    def seek(self, moment: int) -> None:
        """Find ways at a moment and follow each to both sides, to the ends if it meets no other: it may be cheap far off."""
        frame, chosen = int(self.frames[moment]), self.sketching
        found = ways(self.solver, self._wished(moment), self.edges, frame)
        for pose in found[: chosen.ways]:
            if pose.cost < chosen.worth * found[0].cost:
                self._go_on(pose, moment)

    def dearest(self, path: list[Pose], stride: int) -> list[int]:
        """The moments at which a path costs most, one of every `stride`, if much more than where ways were sought.

        Limbs that swing once in a stride look alike wherever ways are sought, and may be caught on the way between.
        """
        costs, dear = np.array([pose.cost for pose in path]), []
        for first in range(0, len(path), stride):
            worst = first + int(costs[first : first + stride].argmax())
            if worst >= self.first and costs[worst] > self.sketching.caught * costs[first]:
                dear.append(worst)
        return dear

    def cross(self, path: list[Pose]) -> None:
        """Where a path leaps, find one beside it that the joints can follow."""
        angles = np.array([pose.qpos[self.hinges] for pose in path])
        reach = self.solver.robot.max_speed * np.diff(self.times).max(initial=0.0)
        paced = within_speeds(angles, reach, self.first)
        for k in np.flatnonzero(np.abs(paced - angles).max(axis=1) > self.sketching.same):
            start = path[k].qpos.copy()
            start[self.hinges] = paced[k]
            near = [paced[j] for j in (k - 1, k + 1) if 0 <= j < len(path)]
            pose = self._descend(start, int(k), self.solver.ranges.around(near, reach))
            paced[k] = pose.qpos[self.hinges]
            self.poses[k].append(pose)

    def mix(self, path: list[Pose], stride: int) -> bool:
        """Find poses between a path and what is cheaper beside it, limb by limb, and follow them; whether there were any.

        Arms and head change ways apart from each other, and poses that are followed whole hold few of the combinations.
        Of every `stride` moments the one is looked at where the path exceeds the cheapest pose most.
        """
        least = np.array([min(pose.cost for pose in poses) for poses in self.poses])
        excess, found = np.array([pose.cost for pose in path]) - least, False
        for first in range(self.first, len(path), stride):
            moment = first + int(excess[first : first + stride].argmax())
            if excess[moment] > self.sketching.dear * path[moment].cost:
                cheaper = [pose for pose in self._mixed(path[moment], moment) if pose.cost < path[moment].cost]
                cheaper.sort(key=lambda pose: pose.cost)  # not by sides: of two that are alike only the first is kept
                found |= any([self._go_on(pose, moment) for pose in cheaper])
        return found

    def cheapest(self, hurry: float) -> list[Pose]:
        """Viterbi's path: least sum of the frames' costs and of the changes between them."""
        total = np.array([p.cost for p in self.poses[0]])
        back: list[np.ndarray] = []
        for k in range(1, len(self.poses)):
            steps = total[:, None] + self._changes(k, hurry)
            back.append(steps.argmin(axis=0))
            total = steps.min(axis=0) + [p.cost for p in self.poses[k]]
        path = [int(total.argmin())]
        for choice in reversed(back):
            path.append(int(choice[path[-1]]))
        return [poses[k] for poses, k in zip(self.poses, reversed(path), strict=True)]

    def _changes(self, k: int, hurry: float) -> Floats:
        """(A, B) what it costs to go from every pose of the moment before to every one of a moment."""
        robot, before, here = self.solver.robot, self.poses[k - 1], self.poses[k]
        turned = np.array([[difference(robot, a.qpos, b.qpos) for b in here] for a in before])
        reach = robot.max_speed * (self.times[k] - self.times[k - 1])
        hurried = np.maximum(np.abs(turned[..., robot.dof_index]) - reach, 0.0)
        return self.sketching.change * (turned**2).sum(axis=2) + hurry * (hurried**2).sum(axis=2)

    @cached_property
    def _limbs(self) -> list[Ints]:
        """Where the angles of arms and head stand in a configuration."""
        return [self.hinges[list(limb)] for limb in drawn_limbs(self.solver)]

    def _mixed(self, here: Pose, moment: int) -> Iterator[Pose]:
        """Where descents end from a pose with one limb of a cheaper one, and from that with one limb of this."""
        cheaper = sorted((pose for pose in self.poses[moment] if pose.cost < here.cost), key=lambda pose: pose.cost)
        for other, limb in product(cheaper[: self.sketching.donors], self._limbs):
            if np.abs(here.qpos[limb] - other.qpos[limb]).max(initial=0.0) < self.sketching.same:
                continue
            for whole, part in ((here, other), (other, here)):
                start = whole.qpos.copy()
                start[limb] = part.qpos[limb]
                yield self._descend(self.solver.symmetry.both_sides(whole.qpos, start), moment)

    def _go_on(self, pose: Pose, moment: int) -> bool:
        """Keep a pose and follow it to both sides, unless it is there already."""
        if not self._add(moment, pose):
            return False
        self._follow(pose, moment, range(moment + 1, len(self.frames)))
        self._follow(pose, moment, range(moment - 1, self.first - 1, -1))
        return True

    def _follow(self, pose: Pose, here: int, moments: range) -> None:
        """Descend at one moment after the other, each time no further than the joints turn from one to the next."""
        for moment in moments:
            reach = self.solver.robot.max_speed * abs(self.times[moment] - self.times[here])
            pose = self._descend(pose.qpos, moment, self.solver.ranges.around([pose.qpos[self.hinges]], reach))
            if not self._add(moment, pose):
                return
            here = moment

    def _descend(self, qpos: Floats, moment: int, box: Box | None = None) -> Pose:
        """Where a rough descent ends whose hinges stay in a box."""
        most, least_gain = self.sketching.iterations, self.sketching.tolerance
        return self.solver.descend(qpos, self._wished(moment), iterations=most, tolerance=least_gain, box=box)

    def _add(self, moment: int, pose: Pose) -> bool:
        """Keep a pose unless it is there already."""
        angles = pose.qpos[self.hinges]
        if any(np.abs(angles - p.qpos[self.hinges]).max() < self.sketching.same for p in self.poses[moment]):
            return False
        self.poses[moment].append(pose)
        return True

    def _wished(self, moment: int) -> tuple[Floats, ...]:
        return lying(self.solver, self.edges, self.held, int(self.frames[moment]))
