"""The candidate set: poses of a clip in several basins of attraction, and the cheapest path through them.

An arm of three joints can follow a human arm in several ways, and a solver that works frame by frame stays in the basin
in which it began. This module descends from the reference pose at moments of a clip, and from several starts at the
dearest of them. It follows each pose forward and backward at a low frame rate until it meets another pose, and chooses the
path of least cost by dynamic programming. Links that pass through each other between two moments make a way dear.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import SweptConfiguration, difference, integrate
from robot_retarget.robot.model import HINGE
from robot_retarget.solver.descent import Box, FrameSolution
from robot_retarget.solver.limits import Targets, within_speeds
from robot_retarget.solver.options import Search
from robot_retarget.solver.quadratic import Between, Proximal
from robot_retarget.solver.sqp import FrameSolver
from robot_retarget.solver.starts import multistart, place_root, same_basin

DEEP = 0.02
"""Links that are deeper in each other on the way between two moments pass through each other, over the leg [-]. With 0, four
clips cost the same on the G1 and 0.99 of it on the OP3."""

SHARES = (0.5,)
"""Shares of the way between two moments at which overlaps are measured [-]. With .2, .4, .6 and .8 seven clips cost the same
on the G1 and six within 1 % on the OP3, at 1.4 times the measurements of links."""


def coarse_path(solver: FrameSolver, graph: RobotGraph, all_targets: Targets, search: Search) -> list[Floats]:
    """Return a configuration (nq,) per frame: the cheapest path through the candidates, on splines between moments."""
    frames = np.unique([*range(0, len(graph), max(1, round(graph.fps / search.rate))), len(graph) - 1])
    found = Candidates(solver, graph, all_targets, frames, search)
    found.search()
    found.bridge()
    return interpolated(solver.robot, frames, [pose.qpos for pose in found.cheapest()])


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
    all_targets: Targets
    search_options: Search
    frames: Ints
    times: Floats
    hinges: Ints

    def __init__(
        self, solver: FrameSolver, graph: RobotGraph, all_targets: Targets, frames: np.ndarray, search: Search
    ):
        self.solver, self.graph, self.all_targets, self.search_options = solver, graph, all_targets, search
        self.frames, self.times = frames, frames / graph.fps
        self.poses: list[list[FrameSolution]] = [[] for _ in frames]
        self.through: dict[tuple[FrameSolution, FrameSolution], float] = {}
        self.hinges = solver.robot.qpos_index
        self.bounds = solver.problem.limits.bounds(all_targets)

    def search(self) -> None:
        """Find poses at moments and at the ends; follow each to both sides.

        The reference pose reaches one at each moment. Where these are dearest and at both ends, poses with drawn limbs start too.
        """
        last, search = len(self.frames) - 1, self.search_options
        stride = max(1, round(search.every / np.diff(self.times).max(initial=1 / search.rate)))
        moments = sorted({*range(0, last, stride), last})
        found = self._reached(moments)
        costly = dearest([pose.cost for pose in found], round(search.dear * len(found)))
        dear = [moments[k] for k in sorted({*costly, 0, len(found) - 1})]
        drawn = multistart(self.solver, self.graph, self.all_targets, self.frames[dear].tolist(), search)
        every = [*zip((poses[0] for poses in drawn), dear, strict=True), *zip(found, moments, strict=True)]
        starts = [(pose, k) for pose, k in every if self._add(k, pose)]
        self._follow([PoseChain(pose, moment, way) for pose, moment in starts for way in (1, -1)])

    def _reached(self, moments: list[int]) -> list[FrameSolution]:
        """Return the ends of descents from the reference pose at moments."""
        frames, reference = self.frames[moments].tolist(), self.solver.robot.neutral()
        return self.solver.solve_frames(
            np.array(place_root(self.graph, reference, frames)),
            self.all_targets.at(np.array(frames)),
            iterations=self.search_options.reached,
            tolerance=self.search_options.tolerance,
        )

    def bridge(self) -> None:
        """Add poses that the joints can reach in time where the path would jump to a cheaper basin."""
        path = self.cheapest(beyond_speed=0.0)
        angles = np.array([pose.qpos[self.hinges] for pose in path])
        reach = self.bounds.speed.min(axis=0) * np.diff(self.times).max(initial=0.0)
        paced, last = within_speeds(angles, reach), len(path) - 1
        jumps = np.flatnonzero(np.abs(paced - angles).max(axis=1) > self.search_options.same)
        for half in (jumps[jumps % 2 == 0], jumps[jumps % 2 == 1]):  # so that neighbours do not move
            if not half.size:
                continue
            start = np.array([path[k].qpos for k in half.tolist()])
            start[:, self.hinges] = paced[half]
            sides = (half - 1).clip(0), (half + 1).clip(max=last)
            near = [(paced[side], np.where((side == half)[:, None], np.inf, reach)) for side in sides]
            for k, pose in zip(half.tolist(), self._descend(start, half, self._ranges(half).around(near)), strict=True):
                paced[k] = pose.qpos[self.hinges]
                self.poses[k].append(pose)

    def cheapest(self, beyond_speed: float | None = None) -> list[FrameSolution]:
        """Return the path of least cost whose ways between moments keep links apart, where such a path is known."""
        changes = self._changes(self.search_options.beyond_speed if beyond_speed is None else beyond_speed)
        while True:
            chosen = self._viterbi(changes)
            path = [poses[k] for poses, k in zip(self.poses, chosen, strict=True)]
            new = [k for k, way in enumerate(itertools.pairwise(path)) if way not in self.through]
            if not new:
                return path
            qpos = np.array([pose.qpos for pose in path])
            depth = self._depths(qpos[new], qpos[1:][new]).max(axis=1)
            costs = self.search_options.through * np.where(depth > DEEP, depth, 0.0) ** 2
            for k, cost in zip(new, costs.tolist(), strict=True):
                self.through[path[k], path[k + 1]] = cost
                changes[k][chosen[k], chosen[k + 1]] += cost

    def _depths(self, before: Floats, after: Floats) -> Floats:
        """Return the overlaps of links (N, S) at `SHARES` of the ways between configurations (N, nq), over the leg [-]."""
        robot, every = self.solver.robot, np.repeat(before, len(SHARES), axis=0)
        turned = difference(robot, before, after)[:, None] * np.array(SHARES)[:, None]
        depths = self.solver.costs.overlap(integrate(robot, every, turned.reshape(len(every), -1)))
        return depths.reshape(-1, len(SHARES)) / self.solver.leg

    def _viterbi(self, changes: list[Floats]) -> list[int]:
        """Return Viterbi's path, a pose per moment: the least sum of the moments' costs and of the changes between them."""
        cost = [np.array([pose.cost for pose in poses]) for poses in self.poses]
        total, back = cost[0], []
        for change, own in zip(changes, cost[1:], strict=True):
            steps = total[:, None] + change
            back.append(steps.argmin(axis=0))
            total = steps.min(axis=0) + own
        path = [int(total.argmin())]
        for choice in reversed(back):
            path.append(int(choice[path[-1]]))
        return path[::-1]

    def _changes(self, beyond_speed: float) -> list[Floats]:
        """Return (A, B) per two moments the cost of the change from every pose of the first to every pose of the second."""
        pairs = [list(itertools.product(*two)) for two in itertools.pairwise(self.poses)]
        ways = [way for each in pairs for way in each]
        if not ways:
            return []
        before, after = (np.array([pose.qpos for pose in side]) for side in zip(*ways, strict=True))
        reach = np.array([self._reach(k, k + 1) for k in range(len(pairs))])
        turned = difference(self.solver.robot, before, after)
        cost = self._change(turned, np.repeat(reach, [len(each) for each in pairs], axis=0), beyond_speed)
        cost += [self.through.get(way, 0.0) for way in ways]
        parts = np.split(cost, np.cumsum([len(each) for each in pairs])[:-1])
        return [part.reshape(len(one), -1) for part, one in zip(parts, self.poses, strict=False)]

    def _change(self, turned: Floats, reach: Floats, beyond_speed: float) -> Floats:
        """Return the costs (…) of changes (…, nv) between moments, in which the hinges reach (…, n) within their speeds."""
        beyond = np.maximum(np.abs(turned[..., self.solver.robot.dof_index]) - reach, 0.0)
        return self.search_options.change * (turned**2).sum(axis=-1) + beyond_speed * (beyond**2).sum(axis=-1)

    def _follow(self, chains: "list[PoseChain]") -> None:
        """Take all chains from moment to moment, within the angles that the joints reach, until they meet known poses."""
        while chains := [chain for chain in chains if 0 <= chain.moment + chain.way < len(self.frames)]:
            moments = [chain.moment + chain.way for chain in chains]
            near = [(c.pose.qpos[self.hinges], self._reach(c.moment, m)) for c, m in zip(chains, moments, strict=True)]
            angles, reach = (np.array(side) for side in zip(*near, strict=True))
            box = self._ranges(np.array(moments)).around([(angles, reach)])
            found = self._around_links(chains, np.array(moments), box)
            steps = [self._longer(*each) for each in zip(chains, moments, found, strict=True)]
            chains = [chain for chain in steps if chain is not None]

    def _around_links(self, chains: "list[PoseChain]", moments: Ints, box: Box) -> list[FrameSolution]:
        """Return the next poses of chains; where links pass through each other on the way, they go around."""
        start = np.array([chain.pose.qpos for chain in chains])
        found = self._descend(start, moments, box)
        depths = self._depths(start, np.array([pose.qpos for pose in found]))
        through = np.flatnonzero(depths.max(axis=1) > DEEP)
        if through.size:
            ways = [(SweptConfiguration(start[k], SHARES[depths[k].argmax()]),) for k in through]
            again = self._descend(start[through], moments[through], box.at(through), ways)
            for k, pose in zip(through, again, strict=True):
                found[k] = pose
        return found

    def _longer(self, chain: PoseChain, moment: int, pose: FrameSolution) -> PoseChain | None:
        """Keep the next pose of a chain; return the chain, or None where it meets a known pose.

        A chain also ends where its excess is larger than the cost of a change to the cheapest pose.
        """
        best = min(self.poses[moment], key=lambda each: each.cost, default=pose)
        if not self._add(moment, pose):
            return None
        excess = chain.excess + max(pose.cost - best.cost, 0.0)
        turned = difference(self.solver.robot, pose.qpos, best.qpos)
        change = self._change(turned, self._reach(chain.moment, moment), self.search_options.beyond_speed)
        return None if excess > change else PoseChain(pose, moment, chain.way, excess)

    def _reach(self, one: int, other: int) -> Floats:
        """Return (n,) how far the hinges turn between two moments, at the least speed of the frames between [rad]."""
        first, last = sorted((int(self.frames[one]), int(self.frames[other])))
        return self.bounds.speed[first + 1 : last + 1].min(axis=0) * abs(self.times[other] - self.times[one])

    def _ranges(self, moments: Ints) -> Box:
        """Return the ranges of the hinges at moments (N,)."""
        frames = self.frames[moments]
        return Box(self.bounds.lower[frames], self.bounds.upper[frames])

    def _descend(self, qpos: Floats, moments: Ints, box: Box, between: Between | None = None) -> list[FrameSolution]:
        """Return the ends of rough descents from configurations (N, nq); hinges stay in a box, links apart on given ways.

        A change from the configurations has a small cost, which fixes directions without other costs.
        """
        targets, search, nv = (
            self.all_targets.at(self.frames[moments]),
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
            between=between,
        )

    def _add(self, moment: int, pose: FrameSolution) -> bool:
        """Keep a pose unless the moment has one in its basin; of two in one basin, keep the cheaper."""
        known = self.poses[moment]
        for k, other in enumerate(known):
            if same_basin(self.solver, pose, other, self.search_options):
                known[k] = min(pose, other, key=lambda each: each.cost)
                return False
        known.append(pose)
        return True


def dearest(cost: Sequence[float], most: int) -> list[int]:
    """Return which of a row of costs are the largest, no two of them neighbours: this number of them, and one at least."""
    chosen: list[int] = []
    for k in np.argsort(-np.array(cost), kind="stable").tolist():
        if len(chosen) < max(most, 1) and all(abs(k - other) > 1 for other in chosen):
            chosen.append(k)
    return chosen


def interpolated(robot: Robot, frames: np.ndarray, poses: list[Floats]) -> list[Floats]:
    """Return configurations at every frame, on cubic splines through the given ones.

    Args:
        frames: of the `poses`, from 0 on.
    """
    known, wanted = np.array(poses), np.arange(frames[-1] + 1)
    if len(known) == 1:
        return poses
    turning = [int(robot.model.jnt_qposadr[j]) for j in robot.root_joints if robot.model.jnt_type[j] == HINGE]
    known[:, turning] = np.unwrap(known[:, turning], axis=0)
    full, hinges = CubicSpline(frames, known)(wanted), robot.qpos_index
    full[:, hinges] = full[:, hinges].clip(robot.lower, robot.upper)
    if robot.floating:
        a = robot.root_address + 3
        turns = RotationSpline(frames, Rotation.from_quat(known[:, a : a + 4], scalar_first=True))
        full[:, a : a + 4] = turns(wanted).as_quat(scalar_first=True)
    return list(full)
