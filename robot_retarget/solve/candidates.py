"""The candidate set: poses of a clip in several basins of attraction, and the cheapest path through them.

An arm of three joints can follow a human arm in several ways, and a solver that works frame by frame stays in the basin
in which it began. This module descends from several starts at moments spread over the clip. It follows each pose
forward and backward at a low frame rate until it meets another pose, and chooses the path of least cost by dynamic
programming.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.arrays import Floats, Ints
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.status import Status
from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.anatomy import limb_hinges
from robot_retarget.robot.kinematics import difference
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.robot.model import HINGE
from robot_retarget.robot.root import place_body
from robot_retarget.solve.descent import Box, FrameSolution
from robot_retarget.solve.options import Search
from robot_retarget.solve.problem import ClipTargets, EdgeTargets
from robot_retarget.solve.quadratic import Proximal
from robot_retarget.solve.speeds import within_speeds
from robot_retarget.solve.sqp import FrameSolver

LIMBS = ("l_hand", "r_hand", "head")
"""Ends of the limbs that change basins independently."""


def coarse_path(
    solver: FrameSolver, graph: RobotGraph, all_targets: ClipTargets, search: Search, known: list[Floats] | None = None
) -> list[Floats]:
    """Return a configuration (nq,) per frame: the cheapest path through the candidates, on splines between moments.

    Args:
        known: configurations of the first frames; the path starts from the last of them.
    """
    first, fps = known or [], graph.fps
    step, start = max(1, round(fps / search.rate)), max(len(first) - 1, 0)
    beats = np.arange(0, len(graph), step)  # independent of known frames: every window seeks at the same ones
    frames = np.unique([start, *beats[beats > start], len(graph) - 1])
    found = Candidates(solver, graph, all_targets, frames, search)
    stride = max(1, round(search.every * fps / step))
    if first:
        found.start_from(first[-1])
    found.search(np.unique([*range(stride if first else 0, len(frames), stride), len(frames) - 1]))
    found.bridge()
    path = found.cheapest()
    before = first[max(start - 2, 0) : start]
    return [*first[:start], *interpolated(solver.robot, frames - start, [pose.qpos for pose in path], before)]


@dataclass(frozen=True, eq=False)
class PoseChain:
    """A pose that is followed from moment to moment."""

    pose: FrameSolution
    moment: int
    way: int
    """1 forward, −1 backward."""
    excess: float = 0.0
    """Σ over its moments of its cost beyond that of the cheapest other pose."""


class Candidates:
    """Poses found until now, per moment."""

    solver: FrameSolver
    graph: RobotGraph
    all_targets: ClipTargets
    search_options: Search
    frames: Ints
    times: Floats
    hinges: Ints
    first: int

    def __init__(
        self, solver: FrameSolver, graph: RobotGraph, all_targets: ClipTargets, frames: np.ndarray, search: Search
    ):
        self.solver, self.graph, self.all_targets, self.search_options = solver, graph, all_targets, search
        self.frames, self.times = frames, frames / graph.fps
        self.poses: list[list[FrameSolution]] = [[] for _ in frames]
        self.hinges, self.first = solver.robot.qpos_index, 0
        self.bounds = solver.problem.limits.bounds(all_targets)

    def start_from(self, qpos: Floats) -> None:
        """Start with a given pose, which stays the only one of the first moment, and follow it."""
        pose = FrameSolution(qpos, Status.CONVERGED, 0.0, 0)
        self.poses[0].append(pose)
        self.first = 1
        self._follow([PoseChain(pose, 0, 1)])

    def search(self, moments: Ints) -> None:
        """Find poses of some moments and follow each to both sides, until it meets another or an end.

        The first and the last of the moments are followed over the whole clip before the others.
        """
        frames, search = self.frames[moments].tolist(), self.search_options
        found = multistart(self.solver, self.graph, self.all_targets, frames, search)
        self._start(moments.tolist(), [ends[: search.followed] for ends in found])

    def _start(self, moments: list[int], found: list[list[FrameSolution]]) -> None:
        """Keep the poses found at moments that are in no known basin, and follow each to both sides."""
        starts = [(pose, k) for k, poses in zip(moments, found, strict=True) for pose in poses if self._add(k, pose)]
        self._follow([PoseChain(pose, moment, way) for pose, moment in starts for way in (1, -1)])

    def bridge(self) -> None:
        """Add poses that the joints can reach in time where the path would jump to a cheaper basin."""
        path = self.cheapest(beyond_speed=0.0)
        angles = np.array([pose.qpos[self.hinges] for pose in path])
        reach = self.bounds.speed.min(axis=0) * np.diff(self.times).max(initial=0.0)
        paced = within_speeds(angles, reach, self.first)
        for k in np.flatnonzero(np.abs(paced - angles).max(axis=1) > self.search_options.same):
            start = path[k].qpos.copy()
            start[self.hinges] = paced[k]
            near = [(paced[j], reach) for j in (k - 1, k + 1) if 0 <= j < len(path)]
            box = self._ranges(np.array([k])).around(near)
            pose = self._descend(start[None], np.array([k]), box)[0]
            paced[k] = pose.qpos[self.hinges]
            self.poses[k].append(pose)

    def cheapest(self, beyond_speed: float | None = None) -> list[FrameSolution]:
        """Return Viterbi's path: the least sum of the moments' costs and of the changes between them."""
        beyond = self.search_options.beyond_speed if beyond_speed is None else beyond_speed
        total = np.array([p.cost for p in self.poses[0]])
        back: list[np.ndarray] = []
        for k in range(1, len(self.poses)):
            steps = total[:, None] + self._changes(k, beyond)
            back.append(steps.argmin(axis=0))
            total = steps.min(axis=0) + [p.cost for p in self.poses[k]]
        path = [int(total.argmin())]
        for choice in reversed(back):
            path.append(int(choice[path[-1]]))
        return [poses[k] for poses, k in zip(self.poses, reversed(path), strict=True)]

    def _changes(self, k: int, beyond_speed: float) -> Floats:
        """Return (A, B) the cost of the change from every pose of the previous moment to every pose of this moment."""
        robot, before = self.solver.robot, np.array([pose.qpos for pose in self.poses[k - 1]])
        turned = np.stack(
            [difference(robot, before, np.broadcast_to(pose.qpos, before.shape)) for pose in self.poses[k]], 1
        )
        beyond = np.maximum(np.abs(turned[..., robot.dof_index]) - self._reach(k - 1, k), 0.0)
        return self.search_options.change * (turned**2).sum(axis=2) + beyond_speed * (beyond**2).sum(axis=2)

    def _follow(self, chains: "list[PoseChain]") -> None:
        """Take all chains from moment to moment, within the angles that the joints reach, until they meet known poses."""
        while chains := [chain for chain in chains if self.first <= chain.moment + chain.way < len(self.frames)]:
            moments = [chain.moment + chain.way for chain in chains]
            near = [(c.pose.qpos[self.hinges], self._reach(c.moment, m)) for c, m in zip(chains, moments, strict=True)]
            angles, reach = (np.array(side) for side in zip(*near, strict=True))
            box = self._ranges(np.array(moments)).around([(angles, reach)])
            found = self._descend(np.array([chain.pose.qpos for chain in chains]), np.array(moments), box)
            steps = [self._longer(*each) for each in zip(chains, moments, found, strict=True)]
            chains = [chain for chain in steps if chain is not None]

    def _longer(self, chain: PoseChain, moment: int, pose: FrameSolution) -> PoseChain | None:
        """Keep the next pose of a chain; return the chain, or None where it meets a known pose.

        A chain also ends where its excess is too large against the cost of a change to the cheapest pose.
        """
        best = min(self.poses[moment], key=lambda each: each.cost, default=pose)
        if not self._add(moment, pose):
            return None
        excess = chain.excess + max(pose.cost - best.cost, 0.0)
        change, search = difference(self.solver.robot, pose.qpos, best.qpos), self.search_options
        if excess > search.abandoned * search.change * float((change**2).sum()):
            return None
        return PoseChain(pose, moment, chain.way, excess)

    def _reach(self, one: int, other: int) -> Floats:
        """Return (n,) how far the hinges turn between two moments, at the least speed of the frames between [rad]."""
        first, last = sorted((int(self.frames[one]), int(self.frames[other])))
        return self.bounds.speed[first + 1 : last + 1].min(axis=0) * abs(self.times[other] - self.times[one])

    def _ranges(self, moments: Ints) -> Box:
        """Return the ranges of the hinges at moments (N,)."""
        frames = self.frames[moments]
        return Box(self.bounds.lower[frames], self.bounds.upper[frames])

    def _descend(self, qpos: Floats, moments: Ints, box: Box) -> list[FrameSolution]:
        """Return the ends of rough descents from configurations (N, nq); hinges stay in a box.

        A change from the configurations has a small cost, which fixes directions without other costs.
        """
        targets, search, nv = (
            self.all_targets.frames(self.frames[moments]),
            self.search_options,
            self.solver.robot.model.nv,
        )
        unchanged = Proximal(qpos, np.zeros((len(qpos), nv)), np.full(nv, search.held))
        return self.solver.solve_frames(
            qpos,
            targets,
            proximal=unchanged,
            iterations=search.iterations,
            tolerance=search.tolerance,
            box=box,
        )

    def _add(self, moment: int, pose: FrameSolution) -> bool:
        """Keep a pose unless the moment has one in its basin; of two in one basin, keep the cheaper."""
        known = self.poses[moment]
        for k, other in enumerate(known):
            if same_basin(self.solver, pose, other, self.search_options):
                known[k] = min(pose, other, key=lambda each: each.cost) if moment >= self.first else other
                return False
        known.append(pose)
        return True


def multistart(
    solver: FrameSolver, graph: RobotGraph, all_targets: ClipTargets, frames: Sequence[int], search: Search
) -> list[list[FrameSolution]]:
    """Return per frame the minima that descents from several starts reach, the cheapest first.

    Of several ends in one basin, that of the first start is kept.

    Ends in one basin differ by their tolerance, and so would the choice of the cheapest of them.

    The starts are the reference pose, the standing pose, and standing poses with drawn limbs. Each limb is drawn many
    times within its ranges, and the draws are sorted by cost: the first start has the best draw of each limb, the
    second start the second best, and so on.
    """
    limbs, placed = limb_starts(solver, search), []
    for frame in frames:
        reference, standing = (place_root(graph, q, frame) for q in (solver.robot.neutral(), solver.robot.standing()))
        drawn = _limbs_drawn(solver, standing, all_targets.at(frame), limbs, search)
        placed.append([reference, standing, *(solver.clear_of_links(standing, q) for q in drawn)])
    rough, exact = 10 * search.tolerance, search.tolerance
    roughly = descended(solver, all_targets, frames, placed, iterations=search.rough, tolerance=rough)
    starts = []
    for frame, ends in zip(frames, roughly, strict=True):
        minima = _minima(solver, ends, search)[: search.finished]
        combined = _limbs_combined(solver, minima, all_targets.at(frame), limbs)
        starts.append([combined, *(end.qpos for end in minima)])
    most = solver.options.iterations
    return [
        _minima(solver, ends, search)
        for ends in descended(solver, all_targets, frames, starts, iterations=most, tolerance=exact)
    ]


def _limbs_combined(
    solver: FrameSolver, ends: Sequence[FrameSolution], targets: EdgeTargets, limbs: Iterable[tuple[int, ...]]
) -> Floats:
    """Return the first of some poses with each limb as the one of them has it in which the first costs least."""
    combined = ends[0].qpos.copy()
    for limb in limbs:
        columns = solver.robot.qpos_index[list(limb)]
        poses = np.repeat(ends[0].qpos[None], len(ends), axis=0)
        poses[:, columns] = [end.qpos[columns] for end in ends]
        cost = solver.problem.cost(poses, targets.clip.frames(np.zeros(len(poses), dtype=int)))
        combined[columns] = poses[cost.argmin(), columns]
    return combined


def descended(
    solver: FrameSolver,
    all_targets: ClipTargets,
    frames: Sequence[int],
    starts: Sequence[Sequence[Floats]],
    **options: Any,
) -> list[list[FrameSolution]]:
    """Return where descents end, in the order of their starts at some frames."""
    every = all_targets.frames(np.repeat(frames, [len(own) for own in starts]))
    found = iter(solver.solve_frames(np.concatenate(starts), every, **options))
    return [list(islice(found, len(own))) for own in starts]


def _minima(solver: FrameSolver, ends: list[FrameSolution], search: Search) -> list[FrameSolution]:
    """Return one end of every basin, the cheapest first."""
    minima: list[FrameSolution] = []
    for end in ends:
        if not any(same_basin(solver, end, other, search) for other in minima):
            minima.append(end)
    return sorted(minima, key=lambda end: end.cost)


def same_basin(solver: FrameSolver, first: FrameSolution, second: FrameSolution, search: Search) -> bool:
    """Return whether all hinges of two poses differ by no more than the basin threshold `Search.same`."""
    hinges = solver.robot.qpos_index
    return bool(np.abs(first.qpos - second.qpos)[hinges].max(initial=0.0) < search.same)


def _limbs_drawn(
    solver: FrameSolver, base: Floats, targets: EdgeTargets, limbs: Mapping[tuple[int, ...], Floats], search: Search
) -> list[Floats]:
    """Return poses with the best draw of each limb, the second best, and so on."""
    best = [base.copy() for _ in range(search.starts)]
    for limb, angles in limbs.items():
        columns = solver.robot.qpos_index[list(limb)]
        poses = np.repeat(base[None], len(angles), axis=0)
        poses[:, columns] = angles
        cost = solver.problem.cost(poses, targets.clip.frames(np.zeros(len(poses), dtype=int)))
        for start, k in zip(best, np.argsort(cost, kind="stable"), strict=False):
            start[columns] = angles[k]
    return best


def limb_starts(solver: FrameSolver, search: Search) -> dict[tuple[int, ...], Floats]:
    """Return per limb the angles (drawn, n) to try [rad]; the right arm tries the mirror images of the left arm's.

    The name of its end seeds the draws of a limb, and its hinges are drawn along the chain, so that the order in which a
    model lists its bodies does not matter.
    """
    robot, anatomy = solver.robot, solver.problem.match.anatomy
    limbs = {end: limb_hinges(robot, anatomy, end) for end in LIMBS if end in anatomy.sites}
    every = np.zeros((search.drawn, len(robot.lower)))
    for end, limb in limbs.items():
        draws = np.random.default_rng(list(end.encode())).random((search.drawn, len(limb)))
        every[:, limb] = robot.lower[limb] + draws * (robot.upper - robot.lower)[limb]
    mirror = mirror_of(robot, _left(robot, anatomy.forward))
    other = np.clip(mirror.angles(every), robot.lower, robot.upper)
    chosen = {"l_hand": every, "r_hand": other, "head": (every + other) / 2}
    return {
        tuple(limb.tolist()): (chosen[end] if (mirror.partner[limb] >= 0).all() else every)[:, limb]
        for end, limb in limbs.items()
        if limb.size
    }


def _left(robot: Robot, forward: Floats) -> Floats:
    """Return the direction of the robot's left in its reference pose."""
    return np.cross([0.0, 0.0, 1.0], forward)


def place_root(graph: RobotGraph, qpos: Floats, frame: int) -> Floats:
    """Return a pose with its root turned and moved so that the pelvis has its target position and heading."""
    return with_root(graph.robot, graph.match.anatomy, qpos, graph.pelvis[frame], graph.human.facing[frame])


def with_root(robot: Robot, anatomy: Anatomy, qpos: Floats, pelvis: Floats, facing: Floats) -> Floats:
    """Return a pose with its root moved so that the pelvis is at a position (3,) [m] with a rotation (3, 3)."""
    body, axes = anatomy.frames.get("pelvis", (robot.root_body, np.eye(3)))
    site = anatomy.sites.get("pelvis")
    offset = site.offset if site is not None and site.body == body else np.zeros(3)
    return place_body(robot, qpos, body, offset, pelvis, facing @ axes.T)


def interpolated(robot: Robot, frames: np.ndarray, poses: list[Floats], before: list[Floats]) -> list[Floats]:
    """Return configurations at every frame, on cubic splines through the given ones.

    Args:
        frames: of the `poses`, from 0 on; the poses in `before`, at frames −1, −2, …, are further knots.
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
