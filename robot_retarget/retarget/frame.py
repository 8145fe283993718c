"""One frame: a bounded Gauss–Newton method whose steps keep ranges, floor and separation."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints
from robot_retarget.retarget.compiled import QuadraticProgram
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.footing import grip_of
from robot_retarget.retarget.problem import Problem
from robot_retarget.retarget.separation import Separation, carrying
from robot_retarget.retarget.solution import Status
from robot_retarget.robot.coupling import Coupling
from robot_retarget.robot.kinematics import body_frames, difference, integrate

REACH = 0.08
"""Links nearer than this share of a leg are kept apart by rows of the quadratic program."""
MARGIN = 0.006
"""They stay this share of a leg apart."""
SEPARATION_COST = 1e6
"""Per squared leg length of what cannot be kept apart at once: the program is never infeasible."""
COUPLED = 30.0
"""Weight of joints that are geared together and chains that close, over the squared leg length."""
REFUSALS = 6
"""Steps that raised the cost, after which a descent gives up; each makes the next one shorter."""
SUNK = -1e-4
"""A start this deep under the floor [m] takes its first steps whatever they cost."""


@dataclass(frozen=True)
class Options:
    """How long and how carefully to search."""

    iterations: int = 12
    """At most, per frame; twice as many from a start that is no neighbour."""
    tolerance: float = 1e-3
    """Stop when no component of the step exceeds this [rad or m]."""
    trust: float = 0.5
    """Largest step of one hinge in one iteration [rad]."""
    damping: float = 1e-3
    """Levenberg's λ at the outset."""
    starts: int = 3
    """Starts from drawn limbs, where there is no frame before to start from."""
    drawn: int = 80
    """Poses drawn per limb for these."""
    seed: int = 0
    separation: bool = True
    """Keep links apart."""
    footholds: bool = True
    """Keep standing feet where they are."""


@dataclass(frozen=True)
class Pull:
    """Σ w (q ⊖ anchor − offset)²: draws a pose towards another, per tangent direction."""

    anchor: Floats
    offset: Floats
    weight: Floats


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


@dataclass(frozen=True)
class Pose:
    """Where a descent ended."""

    qpos: Floats
    status: Status
    cost: float
    iterations: int


@dataclass(frozen=True)
class _Model:
    """The quadratic model around one configuration."""

    cost: float
    gradient: Floats
    normal: Floats
    rows: Floats
    least: Floats
    """rows @ step ≥ least."""
    sunk: bool


class FrameSolver:
    """The solver of single frames of one problem; holds the compiled quadratic program."""

    def __init__(self, problem: Problem, options: Options, leg: float):
        self.problem, self.options, self.robot = problem, options, problem.robot
        self.hinges, self.leg = self.robot.dof_index, leg
        self.ranges = Box(self.robot.lower, self.robot.upper)
        self.separation = Separation(self.robot, REACH * leg) if options.separation else None
        self.coupling = Coupling(self.robot)
        nv, near = self.robot.model.nv, self.separation.most if self.separation else 0
        self.rows = problem.soles + near
        self.grip = grip_of(self.robot, problem.match.anatomy)
        self.limbs = _limbs(problem)
        self.program = QuadraticProgram(nv + 1, self.rows)  # one slack for all separation rows stands last

    def ways(self, wished: tuple[Floats, ...], edges: Edges, frame: int) -> list[Pose]:
        """Where descents from several starts end, the cheapest first.

        The starts are the reference pose, the standing pose, and standing poses whose limbs are each as they cost
        little among many drawn within their ranges: the best of each limb together, the second best, and so on.
        """
        placed = [
            place_root(self.problem, q, edges.root[frame], edges.facing[frame])
            for q in (self.robot.neutral(), self.robot.standing())
        ]
        placed += self._limbs_drawn(placed[1], wished)
        ends = [self.descend(q, wished, None, 2 * self.options.iterations) for q in placed]
        return sorted(ends, key=lambda pose: pose.cost)

    def _limbs_drawn(self, base: Floats, wished: tuple[Floats, ...]) -> list[Floats]:
        draw, best = np.random.default_rng(self.options.seed), [base.copy() for _ in range(self.options.starts)]
        for limb in self.limbs:
            columns = self.robot.qpos_index[limb]
            angles = draw.uniform(self.robot.lower[limb], self.robot.upper[limb], (self.options.drawn, len(limb)))
            cost = np.empty(len(angles))
            for k, drawn in enumerate(angles):
                pose = base.copy()
                pose[columns] = drawn
                cost[k] = self.problem.model(pose, *wished)[0][0]
            for start, k in zip(best, np.argsort(cost), strict=False):
                start[columns] = angles[k]
        return best

    def descend(
        self, start: Floats, wished: tuple[Floats, ...], pull: Pull | None, iterations: int, box: Box | None = None
    ) -> Pose:
        """Steps within the box, above the floor and apart, until they are small or so many were taken."""
        box = box or self.ranges
        q, damping, trust = start, self.options.damping, self.options.trust
        status = Status.OUT_OF_ITERATIONS
        model = self._model(q, wished, pull)
        taken = refused = 0
        while taken < iterations and refused < REFUSALS and status is Status.OUT_OF_ITERATIONS:
            step = self._step(q, model, damping, trust, box)
            if step is None:
                return self._settled(Pose(q, Status.BLOCKED, model.cost, taken))
            trial = integrate(self.robot, q, step)
            there = self._model(trial, wished, pull)
            if np.abs(step).max() < self.options.tolerance:
                status = Status.CONVERGED
            outside = self._outside(q, box) > 1e-6
            if there.cost < model.cost + 1e-12 or model.sunk or outside:
                q, model, damping, trust = trial, there, max(damping / 4, 1e-6), self.options.trust
                taken += 1
            else:
                damping, trust = damping * 10 + 1e-2, 0.3 * min(trust, float(np.abs(step).max()))
                refused += 1
        return self._settled(Pose(q, status, model.cost, taken))

    def _model(self, q: Floats, wished: tuple[Floats, ...], pull: Pull | None) -> _Model:
        cost, gradient, normal, floor, slope = self.problem.model(q, *wished)
        total = float(cost[0])
        if pull is not None:
            change = difference(self.robot, pull.anchor, q) - pull.offset
            total += float(pull.weight @ change**2)
            gradient = gradient + pull.weight * change
            normal = normal + np.diag(pull.weight)
        if self.coupling.present:
            violation, tie = self.coupling(q)
            total += COUPLED * float(violation @ violation) / self.leg**2
            gradient = gradient + COUPLED * (tie.T @ violation) / self.leg**2
            normal = normal + COUPLED * (tie.T @ tie) / self.leg**2
        nv = len(gradient)
        rows, least = np.zeros((self.rows, nv + 1)), np.full(self.rows, -np.inf)
        rows[: len(floor), :nv], least[: len(floor)] = slope, -floor
        sunk = bool(floor.min(initial=0.0) < SUNK)
        if self.separation is not None:
            distance, apart, rest = self.separation.near(q)
            near = slice(len(floor), len(floor) + len(distance))
            missing = np.minimum(MARGIN * self.leg, rest) - distance  # links that rest nearer may stay so
            rows[near, :nv], rows[near, nv], least[near] = apart, 1.0, missing
            total += SEPARATION_COST * float(missing.max(initial=0.0) / self.leg) ** 2
        return _Model(total, gradient, normal, rows, least, sunk)

    def _step(self, q: Floats, model: _Model, damping: float, trust: float, box: Box) -> Floats | None:
        """The step that minimises the quadratic model within box, trust region, floor and separation."""
        nv = len(model.gradient)
        lower, upper = np.full(nv + 1, -1.0), np.full(nv + 1, 1.0)
        angle = q[self.robot.qpos_index]
        lower[self.hinges] = np.clip(box.lower - angle, -trust, trust)
        upper[self.hinges] = np.clip(box.upper - angle, -trust, trust)
        lower[nv], upper[nv] = 0.0, np.inf
        hessian = np.zeros((nv + 1, nv + 1))
        hessian[:nv, :nv] = model.normal
        hessian[np.arange(nv), np.arange(nv)] += damping
        hessian[nv, nv] = SEPARATION_COST / self.leg**2
        slope = np.append(model.gradient, 0.0)
        step = self.program.solve(hessian, slope, model.rows, model.least, lower, upper)
        return None if step is None else step[:nv]

    def _outside(self, q: Floats, box: Box) -> float:
        """How far a hinge is out of the box [rad]: then a step into it is taken whatever it costs."""
        angle = q[self.robot.qpos_index]
        return float(np.maximum(box.lower - angle, angle - box.upper).max(initial=0.0))

    def _within(self, qpos: Floats) -> Floats:
        q, hinges = np.array(qpos), self.robot.qpos_index
        q[hinges] = np.clip(q[hinges], self.robot.lower, self.robot.upper)
        return q

    def _settled(self, pose: Pose) -> Pose:
        """The pose with its chains closed, its root raised by what curvature let a sole sink under the floor."""
        if self.coupling.present:
            pose = replace(pose, qpos=self._within(self.coupling.closed(pose.qpos)))
        if not (self.robot.floating and self.problem.soles):
            return pose
        depth = float(self.problem.heights(pose.qpos)[0].min())
        if depth >= 0:
            return pose
        raised = np.array(pose.qpos)
        raised[int(self.robot.model.jnt_qposadr[self.robot.root_joints[0]]) + 2] -= depth
        return replace(pose, qpos=raised)


def _limbs(problem: Problem) -> list[Ints]:
    """The hinges of each arm and of the head: those that move the hand or head and not the chest."""
    robot, spots, moves = problem.robot, problem.match.anatomy.spots, carrying(problem.robot.model)
    still = moves[spots["chest"].body] if "chest" in spots else np.zeros(robot.model.nv, dtype=bool)
    limbs = []
    for end in ("l_hand", "r_hand", "head"):
        if end in spots:
            own = np.logical_and(moves[spots[end].body], np.logical_not(still))
            limbs.append(np.flatnonzero(own[robot.dof_index]))
    return [limb for limb in limbs if limb.size]


def place_root(problem: Problem, qpos: Floats, pelvis: Floats, facing: Floats) -> Floats:
    """A pose with its free root turned and moved so that the pelvis has the wished frame (3, 3) and place (3,) [m]."""
    robot, anatomy = problem.robot, problem.match.anatomy
    if not robot.floating:
        return qpos
    body, axes = anatomy.frames.get("pelvis", (robot.root_body, np.eye(3)))
    address = int(robot.model.jnt_qposadr[robot.root_joints[0]])
    moved = np.array(qpos)
    positions, rotations = (frames[0] for frames in body_frames(robot, moved[None]))
    turn = facing @ (rotations[body] @ axes).T
    spot = anatomy.spots.get("pelvis")
    middle = positions[robot.root_body] if spot is None else positions[spot.body] + rotations[spot.body] @ spot.offset
    quaternion = Rotation.from_matrix(turn @ rotations[robot.root_body]).as_quat(scalar_first=True)
    moved[address : address + 7] = [*(pelvis - turn @ (middle - positions[robot.root_body])), *quaternion]
    return moved
