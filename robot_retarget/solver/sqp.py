"""One frame: sequential quadratic programming in a trust region; steps keep ranges, floor and separation."""

from dataclasses import replace
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, as_slice
from robot_retarget.graph.track import Status
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import raise_root, root_dofs
from robot_retarget.robot.kinematics import SweptConfiguration, difference, integrate, parts_between
from robot_retarget.solver.compiled import QuadraticPrograms
from robot_retarget.solver.descent import Box, Descent, FrameSolution, TrustRegions, frame_model
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import Problem
from robot_retarget.solver.quadratic import Between, CostModel, Proximal, Quadratic, diagonal

UNSEEN = 0.03
"""The last step of a descent, which gains little, is accepted without evaluation if no hinge turns further [rad]. With 0,
four clips take 20 % more time, and cost 1.001 of it on the G1 and 0.986 on the OP3."""


class FrameSolver:
    """Solve frames of one problem, independent of each other, with one compiled quadratic program."""

    problem: Problem
    options: SolveOptions
    robot: Robot
    hinges: Ints
    leg: float
    roots: Ints

    def __init__(self, problem: Problem, options: SolveOptions | None = None):
        self.problem, self.options, self.robot = problem, options or SolveOptions(), problem.robot
        self.hinges, self.leg, self.roots = self.robot.dof_index, problem.leg, root_dofs(self.robot)
        self._dofs, self._angles, self._root = map(as_slice, (self.hinges, self.robot.qpos_index, self.roots))
        self.costs: CostModel = CostModel(problem, self.options)
        slack = 1  # of separation; it stands last
        self.programs: QuadraticPrograms = QuadraticPrograms(self.robot.model.nv + slack, self.options.threads)

    def solve_frame(
        self,
        start: Floats,
        targets: Targets,
        *,
        proximal: Proximal | None = None,
        between: tuple[SweptConfiguration, ...] = (),
        box: Box | None = None,
        **options: Any,
    ) -> FrameSolution:
        """Solve one frame as `solve_frames` does; its arguments are those of one frame."""
        return self.solve_frames(
            start[None],
            targets.at(None),
            proximal=proximal and proximal.at(None),
            between=[between] if between else None,
            box=box and box.at(None),
            **options,
        )[0]

    def solve_frames(
        self,
        start: Floats,
        targets: Targets,
        *,
        proximal: Proximal | None = None,
        iterations: int | None = None,
        tolerance: float | None = None,
        box: Box | None = None,
        between: Between | None = None,
    ) -> list[FrameSolution]:
        """Take steps within box, floor and separation until the gain is small or the limit is reached; close chains.

        Args:
            start: (N, nq) configurations.
            targets: of the N frames.
            proximal: draws the poses towards others.
            iterations: accepted steps at most.
            tolerance: a smaller gain ends a descent, as a share of the cost [-].
            box: the interval of each hinge; by default the bounds of the frames.
            between: configurations at which links are kept apart too.
        """
        most = iterations or self.options.iterations
        descent = self.begin(start, targets, box or self.ranges(targets), between)
        descent.proximal, descent.tolerance = proximal, tolerance or self.options.tolerance
        regions, active = descent.regions, np.arange(len(start))
        while active.size:
            active = self._advance(descent, active)
            active = active[(regions.taken[active] < most) & (regions.refused[active] < self.options.refusals)]
        for k, step in descent.last.items():
            descent.qpos[k] = integrate(self.robot, descent.qpos[k], step)
        return self.ended(descent)

    def begin(self, start: Floats, targets: Targets, box: Box, between: Between | None = None) -> Descent:
        """Return descents that start at configurations (N, nq)."""
        base = self.costs.linearize(start, targets, between)
        return Descent(np.array(start), targets, base, TrustRegions(self.options, len(start)), box, between=between)

    def ended(self, descent: Descent) -> list[FrameSolution]:
        """Return the poses of a descent, with closed chains."""
        base, taken = descent.base, descent.regions.taken.tolist()
        columns = descent.qpos, descent.status, base.cost.tolist(), taken, base.clearance_deficit.tolist()
        return [self.closed(FrameSolution(*each)) for each in zip(*columns, strict=True)]

    def _advance(self, descent: Descent, active: Ints) -> Ints:
        """Try a step of the active frames and accept it where the cost falls; return the frames that still move."""
        q, base, index = descent.qpos[active], descent.base, self.robot.qpos_index
        own = self.costs.with_proximal(base.of(active), q, descent.proximal and descent.proximal.at(active))
        box, regions = descent.box.at(active), descent.regions
        entering = descent.entering[active] & (box.outside(q[:, index]) > 1e-6)
        descent.entering[active] = entering
        step, slack, kept = self._steps(q, own, regions.radius[active], regions.damping[active], box)
        gain = self.costs.decrease(own, step, slack)
        small = np.abs(step[:, self.hinges]).max(axis=1, initial=0.0) < UNSEEN
        done = kept & small & (gain <= descent.tolerance * own.cost + 1e-12) & ~(own.penetrates_floor | entering)
        descent.status[active[~kept]], descent.status[active[done]] = Status.BLOCKED, Status.CONVERGED
        descent.last |= zip(active[done].tolist(), step[done], strict=True)
        going = kept & ~done
        active, step = active[going], step[going]
        if not active.size:
            return active
        moved = integrate(self.robot, q[going], step)
        targets, between = descent.at(active)
        trial = self.costs.linearize(moved, targets, between, base.near.of(active))
        lowered = self.costs.with_proximal(trial, moved, descent.proximal and descent.proximal.at(active))
        into = entering[going] & (trial.clearance_deficit <= own.clearance_deficit[going])
        taken = (lowered.cost < own.cost[going]) | into | own.penetrates_floor[going]
        descent.qpos[active[taken]] = moved[taken]
        base.put(active, trial, taken)
        regions.take(active[taken])
        regions.refuse(active[~taken], step[~taken])
        return active

    def real_time_step(
        self,
        start: Floats,
        targets: Targets,
        proximal: Proximal | None,
        box: Box,
        steps: int,
    ) -> FrameSolution:
        """Take a number of steps and accept each: the real-time iteration of [Diehl2005], from a start that is a good prediction.

        No step follows one that turns every hinge by less than `UNSEEN`, unless links or bodies touch at its end: the slopes
        of their rows change at once.
        """
        q, taken, status, model = start, 0, Status.OUT_OF_ITERATIONS, None
        radius, damping = self.options.trust_region, self.options.damping
        while taken < steps and status is Status.OUT_OF_ITERATIONS:
            model = frame_model(self.costs, q, targets, proximal)
            program = *self._curvature(model.gradient, model.normal, damping), *self._bounds(q, radius, box)
            found, kept = self.programs.solve_frame(*program, model.rows, model.row_lower)
            if not kept:
                status = Status.BLOCKED
                continue
            q, taken = integrate(self.robot, q, found[:-1]), taken + 1
            touch = (model.rows[:, -1] > 0) & (model.rows @ found < model.row_lower + self.options.floor_tolerance)
            if np.abs(found[self._dofs]).max(initial=0.0) < UNSEEN and not touch.any():
                status = Status.CONVERGED
        assert model is not None
        return self.closed(FrameSolution(q, status, model.cost, taken, model.clearance_deficit))

    def _steps(
        self, q: Floats, current: Quadratic, radius: Floats, damping: Floats, box: Box
    ) -> tuple[Floats, Floats, Bools]:
        """Return the steps (N, nv) that minimise the quadratic models within box, trust regions, floor and separation.

        Returns also what links then lack (N,) over the leg, and whether the rows can be kept (N,).
        """
        program = (
            *self._curvature(current.gradient, current.normal, damping[:, None]),
            *self._bounds(q, radius[:, None], box),
        )
        self.costs.work["programs"] += len(q)
        found, kept = self.programs.solve(*program, current.rows, self.costs.tolerant(current.row_lower))
        return found[:, :-1], found[:, -1] / self.leg, kept

    def _curvature(self, gradient: Floats, normal: Floats, damping: Floats | float) -> tuple[Floats, Floats]:
        """Return the damped Hessian (…, nv + 1, nv + 1) and the gradient (…, nv + 1) with the slack of separation."""
        nv = gradient.shape[-1]
        hessian, slope = np.zeros((*gradient.shape[:-1], nv + 1, nv + 1)), np.zeros((*gradient.shape[:-1], nv + 1))
        hessian[..., :nv, :nv], slope[..., :nv] = normal, gradient
        diagonal(hessian)[..., :nv] += damping
        hessian[..., nv, nv] = self.options.overlap_cost / self.leg**2
        return hessian, slope

    def _bounds(self, q: Floats, radius: Floats | float, box: Box) -> tuple[Floats, Floats]:
        """Return the smallest and the largest step (…, nv + 1) within box and trust region, with that of the slack."""
        upper, angle = np.empty((*q.shape[:-1], self.robot.model.nv + 1)), q[..., self._angles]
        upper[:] = 2 * radius
        lower = -upper
        lower[..., self._dofs] = (box.lower - angle).clip(-radius, radius)
        upper[..., self._dofs] = (box.upper - angle).clip(-radius, radius)
        lower[..., -1], upper[..., -1] = 0.0, np.inf
        if box.root is not None:
            anchor, reach = box.root
            moved = difference(self.robot, anchor, q)[..., self._root]
            lower[..., self._root] = np.maximum(np.minimum(-reach - moved, 0.0), -2 * radius)
            upper[..., self._root] = np.minimum(np.maximum(reach - moved, 0.0), 2 * radius)
        return lower, upper

    def closed(self, pose: FrameSolution) -> FrameSolution:
        """Return the pose with closed chains and meshed gears; small steps then stay on the same branch."""
        q, hinges = self.costs.projected(pose.qpos), self.robot.qpos_index
        if q is pose.qpos:
            return pose
        q[hinges] = np.clip(q[hinges], self.robot.lower, self.robot.upper)
        return replace(pose, qpos=q)

    def ranges(self, targets: Targets) -> Box:
        """Return the ranges of the hinges at a frame."""
        bounds = self.problem.limits.bounds(targets)
        return Box(bounds.lower, bounds.upper)

    def reachable(self, before: Floats, targets: Targets, time: float) -> Box:
        """Return the ranges of the hinges at a frame, cut to the angles in reach of a configuration (nq,) within a time [s]."""
        bounds = self.problem.limits.bounds(targets)
        return Box(bounds.lower, bounds.upper).around([(before[self.robot.qpos_index], bounds.speed * time)])

    def depth(self, qpos: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m], for the pairs that are kept apart."""
        return float(self.costs.overlap(qpos[None])[0])

    def depths_between(self, before: Floats, after: Floats) -> Floats:
        """Return the deepest overlaps (N,) of two links between configurations (N, nq) and others [m]."""
        way, checks = difference(self.robot, before, after), parts_between(self.robot, before, after)
        first, pair = checks.cumsum() - checks, np.repeat(np.arange(len(checks)), checks)
        share = (1 + np.arange(len(pair)) - first[pair]) / (1 + checks[pair])
        depth = self.costs.overlap(integrate(self.robot, before[pair], share[:, None] * way[pair]))
        return np.maximum.reduceat(depth, first) if len(first) else depth

    def overlapping(self, qpos: Floats) -> bool:
        """Whether links are inside each other by more than is accepted."""
        return self.depth(qpos) > self.options.overlap

    def repaired(self, before: Floats, pose: FrameSolution, targets: Targets) -> FrameSolution:
        """Return the pose with its links apart and above the floor, for a pose before it (nq,)."""
        return self.raise_above_floor(self.backtrack_to_clearance(before, pose), targets)

    def backtrack_to_clearance(self, before: Floats, pose: FrameSolution) -> FrameSolution:
        """Return the pose moved back towards the one before (nq,) until its links are not inside each other."""
        if not self.overlapping(pose.qpos):
            return pose
        return replace(pose, qpos=self.clear_of_links(before, pose.qpos), status=Status.BLOCKED)

    def clear_of_links(self, before: Floats, after: Floats) -> Floats:
        """Return the last of even shares of the way from one configuration to another with its links apart, or the first."""
        way = difference(self.robot, before, after)
        tried = (integrate(self.robot, before, share * way) for share in np.linspace(1, 1 / 8, 8))
        return next((q for q in tried if not self.overlapping(q)), before)

    def raise_above_floor(self, pose: FrameSolution, targets: Targets) -> FrameSolution:
        """Return the pose with its root raised by its depth under the floor."""
        depth = float(self.problem.inequalities.depth(pose.qpos, targets))
        return self.raised(pose, max(depth, float(self.costs.penetration(pose.qpos[None])[0])))

    def depths_under_floor(self, qpos: Floats, targets: Targets) -> Floats:
        """Return the depths (T,) of the robot under the floor at configurations (T, nq) [m]."""
        return np.maximum(self.problem.inequalities.depth(qpos, targets), self.costs.penetration(qpos))

    def raised(self, pose: FrameSolution, depth: float) -> FrameSolution:
        """Return the pose with its root raised by a depth [m]."""
        return replace(pose, qpos=raise_root(self.robot, pose.qpos, depth)) if depth > 0 else pose
