"""One frame: sequential quadratic programming in a trust region; steps keep ranges, floor and separation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.graph.status import Status
from robot_retarget.robot import Robot
from robot_retarget.robot.dynamics import root_dofs
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.root import raise_root
from robot_retarget.robot.swept import SweptConfiguration, swept_configurations
from robot_retarget.solve.compiled import QuadraticProgram
from robot_retarget.solve.limits import JointBounds
from robot_retarget.solve.options import SolveOptions
from robot_retarget.solve.problem import ClipTargets, EdgeTargets, Problem
from robot_retarget.solve.quadratic import CostModel, Proximal, Quadratic
from robot_retarget.solve.stencils import Neighbours

SHORT = 0.1
"""A refused step hands its contact rows to the next one if it moved nothing farther [rad, m]: slopes from farther off do not
hold here."""
UNSEEN = 0.03
"""The last step of a descent, which gains little, is accepted without evaluation if no hinge turns further [rad]."""


@dataclass(frozen=True)
class Box:
    """The interval of each hinge at a frame: its range, cut to the reach of its neighbours in time. (n,) each."""

    lower: Floats
    upper: Floats
    root: tuple[Floats, Floats] | None = None
    """A configuration (nq,), and the largest distance of the root from it (R,) per tangent direction [m, rad]; None
    leaves it free."""

    def around(self, neighbours: Iterable[tuple[Floats, Floats]]) -> "Box":
        """Return the box within reach of neighbours: angles (n,) and the reach (n,) from them [rad].

        Where two neighbours are too far apart, it is the angle halfway.
        """
        lower, upper = self.lower, self.upper
        for angles, reach in neighbours:
            lower, upper = np.maximum(lower, angles - reach), np.minimum(upper, angles + reach)
        middle = (lower + upper) / 2
        return Box(np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper))

    def outside(self, angles: Floats) -> float:
        """How far an angle is out of the box [rad]: a step into it is accepted at any cost unless links meet."""
        return float(np.maximum(self.lower - angles, angles - self.upper).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class FrameSolution:
    """The end of a descent."""

    qpos: Floats
    status: Status
    cost: float
    """The cost before the last step, which was too small to be evaluated."""
    iterations: int
    model: Quadratic | None = None
    """The quadratic model at the end, without any proximal term: a further descent with the same targets starts from it."""
    clearance_deficit: float = 0.0
    """How much the nearest links lacked to be apart at the last evaluation, over the leg."""


class _TrustRegion:
    """The trust region of a descent, with its counts of accepted and refused steps (Levenberg–Marquardt)."""

    def __init__(self, options: SolveOptions):
        self.longest = self.radius = options.trust_region
        self.damping, self.growth = options.damping, options.growth
        self.taken = self.refused = 0

    def take(self) -> None:
        self.damping, self.radius = max(self.damping / 4, 1e-6), min(self.longest, self.growth * self.radius)
        self.taken, self.refused = self.taken + 1, max(self.refused - 1, 0)

    def refuse(self, step: Floats) -> None:
        self.damping, self.radius = self.damping * 10 + 1e-2, 0.3 * min(self.radius, float(np.abs(step).max()))
        self.refused += 1


class FrameSolver:
    """Solve single frames of one problem with one compiled quadratic program."""

    problem: Problem
    options: SolveOptions
    robot: Robot
    hinges: Ints
    leg: float
    roots: Ints
    costs: CostModel
    diagonal: tuple[Ints, ...]
    program: QuadraticProgram

    def __init__(self, problem: Problem, options: SolveOptions | None = None):
        self.problem, self.options, self.robot = problem, options or SolveOptions(), problem.robot
        self.hinges, self.leg, self.roots = self.robot.dof_index, problem.leg, root_dofs(self.robot)
        self.costs = CostModel(problem, self.options)
        self.diagonal = np.diag_indices(self.robot.model.nv)
        slack = 1  # of separation; it stands last
        self.program = QuadraticProgram(self.robot.model.nv + slack, self.costs.rows)
        self.program.hessian[-1, -1] = self.options.overlap_cost / self.leg**2
        self.program.lower[-1], self.program.upper[-1] = 0.0, np.inf

    def solve_frame(
        self,
        start: Floats | FrameSolution,
        targets: EdgeTargets,
        *,
        proximal: Proximal | None = None,
        around: Neighbours | None = None,
        iterations: int | None = None,
        tolerance: float | None = None,
        box: Box | None = None,
        between: tuple[SweptConfiguration, ...] = (),
    ) -> FrameSolution:
        """Take steps within box, floor and separation until the gain is small or the limit is reached; close chains.

        Args:
            start: a configuration, or a pose that an earlier descent with the same targets reached (warm start).
            around: the frames that costs join with this one.
            box: the interval of each hinge; by default the bounds of the frame.
            between: configurations at which links are kept apart too.
        """
        most, least_gain = iterations or self.options.iterations, tolerance or self.options.tolerance
        box, q = box or self.ranges(targets), start.qpos if isinstance(start, FrameSolution) else start
        known = start.model if isinstance(start, FrameSolution) and not between else None
        base = known or self.costs.linearize(q, targets, between)
        current, region, outside_bounds = self._with_terms(base, q, proximal, around), _TrustRegion(self.options), True
        while region.taken < most and region.refused < self.options.refusals:
            outside_bounds = outside_bounds and box.outside(q[self.robot.qpos_index]) > 1e-6
            step, gain = self._step(q, current, region, box)
            if step is None:
                return self._ended(q, Status.BLOCKED, base, region, between)
            small = float(np.abs(step[self.hinges]).max()) < UNSEEN
            if gain <= least_gain * current.cost + 1e-12 and small and not (current.penetrates_floor or outside_bounds):
                last = integrate(self.robot, q, step)
                return self._closed(
                    FrameSolution(
                        last, Status.CONVERGED, base.cost, region.taken, clearance_deficit=base.clearance_deficit
                    )
                )
            moved = integrate(self.robot, q, step)
            trial = self.costs.linearize(moved, targets, between, current.near)
            lowered = self._with_terms(trial, moved, proximal, around)
            moving_into_bounds = outside_bounds and trial.clearance_deficit <= current.clearance_deficit
            if lowered.cost < current.cost or moving_into_bounds or current.penetrates_floor:
                q, base, current = moved, trial, lowered
                region.take()
            else:
                current = self._with_rows_met(current, trial, step)
                region.refuse(step)
        return self._ended(q, Status.OUT_OF_ITERATIONS, base, region, between)

    def real_time_step(
        self,
        start: Floats,
        targets: EdgeTargets,
        proximal: Proximal | None,
        box: Box,
        steps: int,
        around: Neighbours | None = None,
    ) -> FrameSolution:
        """Take a number of steps and accept each: the real-time iteration of [Diehl2005], from a start that is a good prediction."""
        q, region, status, base = start, _TrustRegion(self.options), Status.OUT_OF_ITERATIONS, None
        for taken in range(steps):
            base = self.costs.linearize(q, targets)
            step, _ = self._step(q, self._with_terms(base, q, proximal, around), region, box)
            if step is None:
                return self._closed(
                    FrameSolution(q, Status.BLOCKED, base.cost, taken, clearance_deficit=base.clearance_deficit)
                )
            q = integrate(self.robot, q, step)
            status = Status.CONVERGED if float(np.abs(step[self.hinges]).max()) < UNSEEN else Status.OUT_OF_ITERATIONS
        assert base is not None
        return self._closed(FrameSolution(q, status, base.cost, steps, clearance_deficit=base.clearance_deficit))

    def _ended(
        self, q: Floats, status: Status, base: Quadratic, region: _TrustRegion, between: tuple[SweptConfiguration, ...]
    ) -> FrameSolution:
        """Return the pose with its model as a warm start, unless the model has rows between the frame and its neighbours."""
        return self._closed(
            FrameSolution(q, status, base.cost, region.taken, None if between else base, base.clearance_deficit)
        )

    def _with_terms(
        self, base: Quadratic, q: Floats, proximal: Proximal | None, around: Neighbours | None
    ) -> Quadratic:
        return self.costs.with_neighbours(self.costs.with_proximal(base, q, proximal), q, around)

    def _step(self, q: Floats, current: Quadratic, region: _TrustRegion, box: Box) -> tuple[Floats | None, float]:
        """Return the step that minimises the quadratic model within box, trust region, floor and separation, and its decrease."""
        program, nv, angle, radius = self.program, len(current.gradient), q[self.robot.qpos_index], region.radius
        program.lower[:nv], program.upper[:nv] = -2 * radius, 2 * radius
        program.lower[self.hinges] = (box.lower - angle).clip(-radius, radius)
        program.upper[self.hinges] = (box.upper - angle).clip(-radius, radius)
        if box.root is not None:
            anchor, reach = box.root
            moved = difference(self.robot, anchor, q)[self.roots]
            program.lower[self.roots] = np.maximum(np.minimum(-reach - moved, 0.0), -2 * radius)
            program.upper[self.roots] = np.minimum(np.maximum(reach - moved, 0.0), 2 * radius)
        program.hessian[:nv, :nv] = current.normal
        program.hessian[self.diagonal] += region.damping
        program.gradient[:nv] = current.gradient
        found = program.solve(current.rows, current.row_lower)
        if found is None:
            return None, 0.0
        return found[:nv], self.costs.decrease(current, found[:nv], float(found[nv]) / self.leg)

    def _with_rows_met(self, current: Quadratic, trial: Quadratic, step: Floats) -> Quadratic:
        """Return the model with the rows of links that a refused short step brought together."""
        met = trial.clearance_deficit > current.clearance_deficit and np.abs(step).max() < SHORT
        return current.with_rows_met(len(self.problem.inequalities), trial, step) if met else current

    def _closed(self, pose: FrameSolution) -> FrameSolution:
        """Return the pose with closed chains and meshed gears; small steps then stay on the same branch."""
        q, hinges = self.costs.projected(pose.qpos), self.robot.qpos_index
        if q is pose.qpos:
            return pose
        q[hinges] = np.clip(q[hinges], self.robot.lower, self.robot.upper)
        return replace(pose, qpos=q, model=None)

    def bounds(self, targets: EdgeTargets) -> JointBounds:
        """Return the bounds of the hinges at a frame."""
        return self.problem.limits.bounds(targets)

    def ranges(self, targets: EdgeTargets) -> Box:
        """Return the ranges of the hinges at a frame."""
        bounds = self.bounds(targets)
        return Box(bounds.lower, bounds.upper)

    def reachable(self, before: Floats, targets: EdgeTargets, time: float) -> Box:
        """Return the angles that the hinges reach at a frame from a configuration (nq,), within a time [s]."""
        bounds = self.bounds(targets)
        return Box(bounds.lower, bounds.upper).around([(before[self.robot.qpos_index], bounds.speed * time)])

    def around(
        self, poses: Sequence[FrameSolution], all_targets: ClipTargets, frame: int, seconds: float
    ) -> Neighbours | None:
        """Return the frames that costs join with a frame of a clip; None if there are none.

        Args:
            poses: of the first frames, or of all frames.
            all_targets: of all frames.
            frame: index of the frame.
            seconds: time from frame to frame [s].
        """
        near = [frame + offset for offset in self.costs.offsets]
        known = {k - frame: poses[k].qpos for k in near if 0 <= k < len(poses)}
        if not known:
            return None
        targets = {k - frame: all_targets.at(k) for k in (frame, *near) if 0 <= k < len(all_targets)}
        return Neighbours(known, targets, seconds)

    def depth(self, qpos: Floats) -> float:
        """Return the depth of the deepest overlap of two links [m], for the pairs that are kept apart."""
        return self.costs.overlap(qpos)

    def depth_between(self, before: Floats, after: Floats) -> float:
        """Return the deepest overlap of two links between two configurations [m]."""
        return max(self.depth(way.at(self.robot, after)) for way in swept_configurations(self.robot, before, after))

    def overlapping(self, qpos: Floats) -> bool:
        """Whether links are inside each other by more than is accepted."""
        return self.depth(qpos) > self.options.overlap

    def repaired(self, before: Floats, pose: FrameSolution, targets: EdgeTargets) -> FrameSolution:
        """Return the pose with its links apart and above the floor, for a pose before it (nq,)."""
        return self.raise_above_floor(self.backtrack_to_clearance(before, pose), targets)

    def backtrack_to_clearance(self, before: Floats, pose: FrameSolution) -> FrameSolution:
        """Return the pose moved back towards the one before (nq,) until its links are not inside each other."""
        if not self.overlapping(pose.qpos):
            return pose
        return replace(pose, qpos=self.clear_of_links(before, pose.qpos), status=Status.BLOCKED, model=None)

    def clear_of_links(self, before: Floats, after: Floats) -> Floats:
        """Return the last of even shares of the way from one configuration to another with its links apart, or the first."""
        way = difference(self.robot, before, after)
        tried = (integrate(self.robot, before, share * way) for share in np.linspace(1, 1 / 8, 8))
        return next((q for q in tried if not self.overlapping(q)), before)

    def raise_above_floor(self, pose: FrameSolution, targets: EdgeTargets) -> FrameSolution:
        """The pose with its root raised by its depth under the floor."""
        depth = max(self.problem.inequalities.depth(pose.qpos, targets), self.costs.penetration(pose.qpos))
        return replace(pose, qpos=raise_root(self.robot, pose.qpos, depth) if depth > 0 else pose.qpos, model=None)
