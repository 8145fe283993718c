"""One frame: a bounded Gauss–Newton method whose steps keep ranges, floor and separation."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.root import raised
from robot_retarget.solve.between import Between, on_the_way
from robot_retarget.solve.compiled import QuadraticProgram
from robot_retarget.solve.footing import CORNERS, grip_of
from robot_retarget.solve.problem import Problem
from robot_retarget.solve.quadratic import SEPARATION_COST, Ahead, Landscape, Pull, Quadratic
from robot_retarget.solve.solution import Status
from robot_retarget.solve.symmetry import doubled, pulls_evenly, symmetry_of

REFUSALS = 6
"""Steps that raised the cost, after which a descent gives up; each makes the next one shorter, each one taken makes up for
one of them."""

OVERLAP = 5e-4
"""Links inside each other by more are not accepted [m]."""
SHORT = 0.1
"""What a refused step met goes along with the next one where it moved nothing farther [rad, m]: slopes from far off tell
nothing here."""
REGAIN = 3.0
"""How much longer the step after one that was accepted may be [-]."""
UNSEEN = 0.03
"""The last step of a descent, which gains little, is taken without looking back when no hinge turns farther [rad]."""


@dataclass(frozen=True)
class Options:
    """How long and how carefully to search."""

    iterations: int = 16
    """At most, per frame; twice as many from a start that is no neighbour."""
    tolerance: float = 2e-5
    """Stop when no step would lower the cost by more than this share of it [-]."""
    trust: float = 0.5
    """Largest step of one hinge in one iteration [rad]; the root's may be twice as large [rad, m]."""
    damping: float = 1e-3
    """Levenberg's λ at the outset."""
    starts: int = 3
    """Starts from drawn limbs, where there is no frame before to start from."""
    drawn: int = 80
    """Poses drawn per limb for these."""
    seed: int = 0
    separation: bool = True
    """Keep links apart ..."""
    margin: float = 0.006
    """... by this share of a leg ..."""
    reach: float = 0.05
    """... by rows of the quadratic program for those nearer than this share."""
    glance: float = 0.0
    """Joints that turned by less since distances were measured let them go on along their slopes [rad]."""
    interaction: float = 0.0
    """Weight of interaction edges, which slow links down that near each other, before separation bites; 0 for none."""
    horizon: float = 0.2
    """How far ahead these look [s]."""
    footholds: bool = True
    """Keep standing feet where they are."""


@dataclass(frozen=True)
class Box:
    """What the hinges may be at a frame: their ranges, cut to what their neighbours in time can reach. (n,) each."""

    lower: Floats
    upper: Floats

    def around(self, neighbours: list[Floats], reach: Floats) -> "Box":
        """Angles within `reach` of every neighbour (n,); where two are too far apart, halfway between them."""
        lower, upper = self.lower, self.upper
        for angles in neighbours:
            lower, upper = np.maximum(lower, angles - reach), np.minimum(upper, angles + reach)
        middle = (lower + upper) / 2
        return Box(np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper))

    def outside(self, angles: Floats) -> float:
        """How far an angle is out of the box [rad]: then a step into it is taken whatever it costs, unless links meet there."""
        return float(np.maximum(self.lower - angles, angles - self.upper).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a descent ended."""

    qpos: Floats
    status: Status
    cost: float
    """Before the last step, which was too small to be worth another look."""
    iterations: int
    around: Quadratic | None = None
    """The model of the cost there, without any pull: a further descent with the same wishes starts from it."""
    missing: float = 0.0
    """How much the nearest links lacked to be apart when last looked at, over the leg length."""


class _Pace:
    """How far the next step of a descent may lead, and how many were taken and refused (Levenberg–Marquardt)."""

    def __init__(self, options: Options):
        self.longest = self.trust = options.trust
        self.damping = options.damping
        self.taken = self.refused = 0

    def take(self) -> None:
        self.damping, self.trust = max(self.damping / 4, 1e-6), min(self.longest, REGAIN * self.trust)
        self.taken, self.refused = self.taken + 1, max(self.refused - 1, 0)

    def refuse(self, step: Floats) -> None:
        self.damping, self.trust = self.damping * 10 + 1e-2, 0.3 * min(self.trust, float(np.abs(step).max()))
        self.refused += 1


class FrameSolver:
    """The solver of single frames of one problem; holds the compiled quadratic program."""

    def __init__(self, problem: Problem, options: Options):
        self.problem, self.options, self.robot = problem, options, problem.robot
        self.hinges, self.leg = self.robot.dof_index, problem.match.robot_leg
        self.ranges = Box(self.robot.lower, self.robot.upper)
        self.landscape = Landscape(problem, options.separation, options.margin, options.reach, options.glance)
        self.symmetry = symmetry_of(self.robot, problem.match.anatomy)
        self.grip = grip_of(self.robot, problem.match.anatomy)
        self.diagonal = np.diag_indices(self.robot.model.nv)
        slack = 1  # of separation; it stands last
        self.program = QuadraticProgram(self.robot.model.nv + slack, self.landscape.rows)
        self.program.hessian[-1, -1] = SEPARATION_COST / self.leg**2
        self.program.lower[-1], self.program.upper[-1] = 0.0, np.inf

    @cached_property
    def unhindered(self) -> "FrameSolver":
        """The same, but links pass through each other: for wishes that a pose with links apart is known to fulfil, as of a
        robot's own motion. Links that slide along each other may stand in the way to it.
        """
        return FrameSolver(self.problem, replace(self.options, separation=False))

    def descend(
        self,
        start: Floats | Pose,
        wished: tuple[Floats, ...],
        *,
        pull: Pull | None = None,
        ahead: Ahead | None = None,
        iterations: int | None = None,
        tolerance: float | None = None,
        box: Box | None = None,
        between: tuple[Between, ...] = (),
        learning: bool = False,
    ) -> Pose:
        """Steps within the box, above the floor and apart, until they gain little or so many were taken; chains closed.

        Args:
            start: a configuration, or a pose that an earlier descent with the same wishes reached.
            between: where links are kept apart besides.
            learning: let each step teach the curvature for the next (`Quadratic.after`), to end exactly in few.
        """
        most, least_gain = iterations or self.options.iterations, tolerance or self.options.tolerance
        box, q = box or self.ranges, start.qpos if isinstance(start, Pose) else start
        known = start.around if isinstance(start, Pose) and not between else None
        base = known or self.landscape.around(q, wished, between)
        here, pace = self._drawn(base, q, pull, ahead), _Pace(self.options)
        strayed = even = True
        while pace.taken < most and pace.refused < REFUSALS:
            # Steps lead into the box and never out of it, but not into other links, and away from evenness for good.
            strayed = strayed and box.outside(q[self.robot.qpos_index]) > 1e-6
            even, forced = even and self.symmetry.even(q), here.sunk or strayed
            step, gain = self._even_step(q, here, pace, box) if even else self._step(q, here, pace, box)
            if step is None:
                return self._closed(self._left(q, Status.BLOCKED, base, pace, between))
            small = float(np.abs(step[self.hinges]).max()) < UNSEEN
            if gain <= least_gain * here.cost + 1e-12 and not forced and small:
                last = integrate(self.robot, q, step)
                return self._closed(Pose(last, Status.CONVERGED, base.cost, pace.taken, missing=base.missing))
            trial = integrate(self.robot, q, step)
            there = self.landscape.around(trial, wished, between)
            pulled = self._drawn(there, trial, pull, ahead)
            entering = strayed and there.missing <= here.missing
            if pulled.cost < here.cost or entering or here.sunk:
                q, base, here = trial, there, pulled.after(step, here) if learning else pulled
                pace.take()
            else:
                here = self._warned(here, there, step)
                pace.refuse(step)
        return self._closed(self._left(q, Status.OUT_OF_ITERATIONS, base, pace, between))

    def _left(self, q: Floats, status: Status, base: Quadratic, pace: "_Pace", between: tuple[Between, ...]) -> Pose:
        """A pose that may be gone on from; what is between it and its neighbours will be elsewhere by then."""
        return Pose(q, status, base.cost, pace.taken, None if between else base, base.missing)

    def _drawn(self, base: Quadratic, q: Floats, pull: Pull | None, ahead: Ahead | None) -> Quadratic:
        return self.landscape.foreseen(self.landscape.pulled(base, q, pull), q, ahead)

    def _step(self, q: Floats, here: Quadratic, pace: "_Pace", box: Box) -> tuple[Floats | None, float]:
        """The step that minimises the quadratic model within box, trust region, floor and separation; what it gains."""
        program, nv, angle, trust = self.program, len(here.gradient), q[self.robot.qpos_index], pace.trust
        program.lower[:nv], program.upper[:nv] = -2 * trust, 2 * trust
        program.lower[self.hinges] = (box.lower - angle).clip(-trust, trust)
        program.upper[self.hinges] = (box.upper - angle).clip(-trust, trust)
        program.hessian[:nv, :nv] = here.normal
        program.hessian[self.diagonal] += pace.damping
        program.gradient[:nv] = here.gradient
        found = program.solve(here.rows, here.least)
        return (None, 0.0) if found is None else (found[:nv], here.decrease(found[:nv], float(found[nv]) / self.leg))

    def _even_step(self, q: Floats, here: Quadratic, pace: "_Pace", box: Box) -> tuple[Floats | None, float]:
        """The same from an even configuration: a step without a side, where nothing pulls to one."""
        reflection = self.symmetry.reflection(q)
        if not pulls_evenly(reflection, here):
            return self._step(q, here, pace, box)
        step, gain = self._step(q, doubled(reflection, here, self.problem.soles), pace, box)
        return (step, gain) if step is None else ((step + reflection @ step) / 2, gain)

    def _warned(self, here: Quadratic, there: Quadratic, step: Floats) -> Quadratic:
        """The model, with what a refused short step has met."""
        met = there.missing > here.missing and np.abs(step).max() < SHORT
        return here.warned(self.problem.soles, there, step) if met else here

    def _closed(self, pose: Pose) -> Pose:
        """The pose with its chains closed and its gears in mesh: small steps then stay on the same branch."""
        if not self.landscape.coupling.present:
            return pose
        q, hinges = self.landscape.coupling.closed(pose.qpos), self.robot.qpos_index
        q[hinges] = np.clip(q[hinges], self.robot.lower, self.robot.upper)
        return replace(pose, qpos=q, around=None)

    def reachable(self, neighbours: list[Floats], time: float) -> Box:
        """What the hinges can be a time [s] from each of some configurations, at their speeds."""
        index = self.robot.qpos_index
        return self.ranges.around([qpos[index] for qpos in neighbours], self.robot.max_speed * time)

    def corners(self, qpos: Floats) -> Floats:
        """(F, 4, 3) where the corners of the soles are [m]."""
        return self.problem.corners(qpos)[0].reshape(len(self.problem.feet), CORNERS, 3)

    def depth(self, qpos: Floats) -> float:
        """How deep links are inside each other [m], where they are kept apart."""
        apart = self.landscape.separation
        return apart.depth(qpos) if apart else 0.0

    def depth_between(self, before: Floats, after: Floats) -> float:
        """How deep links come inside each other on the way from one configuration to another [m]."""
        return max(self.depth(way.at(self.robot, after)) for way in on_the_way(self.robot, before, after))

    def overlapping(self, qpos: Floats) -> bool:
        """Whether links are inside each other by more than `OVERLAP`."""
        return self.depth(qpos) > OVERLAP

    def held_back(self, before: Floats, pose: Pose, wished: tuple[Floats, ...]) -> Pose:
        """A pose whose links are not inside each other: itself, or the nearest of seven on the way from the one before."""
        if not self.overlapping(pose.qpos):
            return pose
        way = difference(self.robot, before, pose.qpos)
        tried = (integrate(self.robot, before, share * way) for share in np.linspace(7 / 8, 1 / 8, 7))
        qpos = next((q for q in tried if not self.overlapping(q)), before)
        here = self.landscape.around(qpos, wished)
        return replace(pose, qpos=qpos, status=Status.BLOCKED, cost=here.cost, missing=here.missing, around=None)

    def lifted(self, pose: Pose) -> Pose:
        """The pose with its root raised by what curvature let it sink under the floor."""
        depth = -float(self.problem.heights(pose.qpos)[0].min()) if self.problem.soles else 0.0
        apart = self.landscape.separation
        depth = max(depth, apart.sunk(pose.qpos)) if apart else depth
        return replace(pose, qpos=raised(self.robot, pose.qpos, depth) if depth > 0 else pose.qpos, around=None)
