"""A coarse path through the right minima, before the fine one is solved.

An arm of three joints can follow a human arm in more ways than one, and a solver that goes frame by frame stays in the
way it began. Here several ways are sought at moments spread over the clip, each is followed forward and backward at a
low frame rate until it meets another, and the cheapest path through all of them is chosen by dynamic programming. Where
that leaps, ways across at the joints' speed are put beside the others, and the path is chosen anew: a leap then costs dear.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.arrays import Floats
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.frame import FrameSolver, Pose
from robot_retarget.retarget.problem import frame_parameters
from robot_retarget.retarget.solution import Status
from robot_retarget.retarget.speeds import within_speeds
from robot_retarget.retarget.starts import ways
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.model import HINGE


@dataclass(frozen=True)
class Sketching:
    """How widely to search."""

    rate: float = 10.0
    """Frames per second of the sketch [1/s]."""
    every: float = 1.0
    """Time between the moments at which ways are sought [s]."""
    iterations: int = 6
    """At most, per frame that is followed: the fine solution comes later."""
    tolerance: float = 1e-3
    """As `Options.tolerance`, for the same reason."""
    ways: int = 3
    """At most, per moment."""
    same: float = 0.15
    """Poses whose hinges all lie nearer than this are one [rad]."""
    change: float = 0.5
    """Cost of a change of pose between frames of the sketch [1/rad²] ..."""
    hurry: float = 30.0
    """... and on top of what hinges turn beyond their speeds: more than a way across costs on its way, if there is one."""


def sketch(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    fps: float,
    sketching: Sketching | None = None,
    known: list[Floats] | None = None,
) -> list[Floats]:
    """A configuration (nq,) for every frame of the clip: the cheapest path through the ways that were found.

    Standing soles `held` (T, F, 4) lie on the floor; where they do is left open. The first frames are `known` already,
    and the path sets out from the last of them.
    """
    chosen, first = sketching or Sketching(), known or []
    step, start = max(1, round(fps / chosen.rate)), max(len(first) - 1, 0)
    beats = np.arange(0, len(edges), step)  # whatever is known: another window sketches the same frames
    frames = np.unique([start, *beats[beats > start], len(edges) - 1])
    pool = _Pool(solver, edges, held, frames, fps, chosen)
    stride = max(1, round(chosen.every * fps / step))
    if first:
        pool.set_out(first[-1])
    for moment in range(stride if first else 0, len(frames), stride):
        pool.seek(moment)
    pool.cross(pool.cheapest(hurry=0.0))
    path = [pose.qpos for pose in pool.cheapest(chosen.hurry)]
    return [*first[:start], *between(solver.robot, frames - start, path, first[max(start - 2, 0) : start])]


class _Pool:
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
        frame = int(self.frames[moment])
        found = ways(self.solver, self._wished(moment), self.edges, frame)
        for pose in found[: self.sketching.ways]:
            if self._add(moment, pose):
                self._follow(pose, moment, range(moment + 1, len(self.frames)))
                self._follow(pose, moment, range(moment - 1, self.first - 1, -1))

    def cross(self, path: list[Pose]) -> None:
        """Where a path leaps, find one beside it that the joints can follow."""
        angles = np.array([pose.qpos[self.hinges] for pose in path])
        reach = self.solver.robot.max_speed * np.diff(self.times).max(initial=0.0)
        paced = within_speeds(angles, reach, self.first)
        for k in np.flatnonzero(np.abs(paced - angles).max(axis=1) > self.sketching.same):
            start = path[k].qpos.copy()
            start[self.hinges] = paced[k]
            pose = self._descend(start, int(k), [paced[j] for j in (k - 1, k + 1) if 0 <= j < len(path)], reach)
            paced[k] = pose.qpos[self.hinges]
            self.poses[k].append(pose)

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

    def _follow(self, pose: Pose, here: int, moments: range) -> None:
        """Descend at one moment after the other, each time no further than the joints turn from one to the next."""
        for moment in moments:
            reach = self.solver.robot.max_speed * abs(self.times[moment] - self.times[here])
            pose = self._descend(pose.qpos, moment, [pose.qpos[self.hinges]], reach)
            if not self._add(moment, pose):
                return
            here = moment

    def _descend(self, qpos: Floats, moment: int, near: list[Floats], reach: Floats) -> Pose:
        """Where a rough descent ends whose hinges stay within reach of near angles."""
        most, least_gain = self.sketching.iterations, self.sketching.tolerance
        box = self.solver.ranges.around(near, reach)
        return self.solver.descend(qpos, self._wished(moment), iterations=most, tolerance=least_gain, box=box)

    def _add(self, moment: int, pose: Pose) -> bool:
        """Keep a pose unless it is there already."""
        angles = pose.qpos[self.hinges]
        if any(np.abs(angles - p.qpos[self.hinges]).max() < self.sketching.same for p in self.poses[moment]):
            return False
        self.poses[moment].append(pose)
        return True

    def _wished(self, moment: int) -> tuple[Floats, ...]:
        frame = int(self.frames[moment])
        return (*frame_parameters(self.edges, frame), *self.solver.grip.lay_down(self.held[frame]))


def between(robot: Robot, frames: np.ndarray, poses: list[Floats], before: list[Floats]) -> list[Floats]:
    """Configurations at every frame, on cubic splines through some: straight lines of a tenth of a second would cut a swing
    of half a radian, once a second, short by 0.025 rad.

    Args:
        frames: from 0 on, of the `poses`; those `before` are at frames −1, −2, … and the splines go on from there.
    """
    known, wanted = np.array([*before, *poses]), np.arange(frames[-1] + 1)
    if len(known) == 1:
        return [known[0]]
    knots = np.concatenate([np.arange(-len(before), 0), frames])
    turning = [int(robot.model.jnt_qposadr[j]) for j in robot.root_joints if robot.model.jnt_type[j] == HINGE]
    known[:, turning] = np.unwrap(known[:, turning], axis=0)
    full, hinges = CubicSpline(knots, known)(wanted), robot.qpos_index
    full[:, hinges] = full[:, hinges].clip(robot.lower, robot.upper)
    if robot.floating:
        a = robot.root_address + 3
        turns = RotationSpline(knots, Rotation.from_quat(known[:, a : a + 4], scalar_first=True))
        full[:, a : a + 4] = turns(wanted).as_quat(scalar_first=True)
    return list(full)
