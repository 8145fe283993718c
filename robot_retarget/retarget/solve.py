"""Solve a clip frame by frame: a bounded Gauss–Newton method, warm-started, with several starts where it must find in."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats
from robot_retarget.retarget.edges import Edges
from robot_retarget.retarget.problem import Problem, frame_parameters
from robot_retarget.robot.kinematics import body_frames, difference, integrate
from robot_retarget.trajectory import Trajectory

Progress = Callable[[int, int], None]
"""Told (frames done, frames in all)."""


class Status(Enum):
    """Why the solver stopped at a frame; the value is the sentence for a person."""

    CONVERGED = "the step fell below the tolerance"
    OUT_OF_ITERATIONS = "the iterations ran out; the pose is usable, not final"
    BLOCKED = "no admissible step was found; the previous pose is kept"


@dataclass(frozen=True)
class Options:
    """How long and how carefully to search."""

    iterations: int = 12
    """At most, per frame; the first frame gets five times as many."""
    tolerance: float = 1e-4
    """Stop when no component of the step exceeds this [rad or m]."""
    trust: float = 0.5
    """Largest step of one hinge in one iteration [rad]."""
    damping: float = 1e-3
    """Levenberg's λ at the outset."""
    smoothness: float = 0.02
    """Weight of a change of joint speed, at 30 frames a second [1/rad²]."""
    starts: int = 8
    """Starts at the first frame, and where a frame got stuck."""
    seed: int = 0


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
    iterations: np.ndarray
    """(T,)."""
    timings: dict[str, float] = field(default_factory=dict)
    """Seconds spent, by stage."""

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

    def worst_edges(self, count: int = 8) -> list[tuple[str, float, int]]:
        """The posture edges with the largest mean error: name, mean error, the frame where it is largest."""
        mean = self.errors.mean(axis=0)
        order = np.argsort(-mean)[:count]
        return [(self.labels[e], float(mean[e]), int(self.errors[:, e].argmax())) for e in order]


def solve(
    problem: Problem,
    edges: Edges,
    fps: float,
    source: str = "",
    options: Options | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Solve every frame in turn, each from the one before.

    Args:
        fps: frames per second of the edges; joint speeds are compared in time, not in frames.
        progress: called after every frame.
    """
    began = time.perf_counter()
    chosen = options or Options()
    solver = _Frame(problem, chosen, fps)
    results: list[_Result] = []
    for t in range(len(edges)):
        parameters = frame_parameters(edges, t)
        history = [r.qpos for r in results[-2:]]
        result = solver.track(parameters, history) if history else solver.find(parameters, edges, t)
        results.append(result)
        if progress:
            progress(t + 1, len(edges))
    qpos = np.array([r.qpos for r in results])
    errors = np.array([np.abs(np.asarray(problem.stress(q, edges.distance[t]))).ravel() for t, q in enumerate(qpos)])
    trajectory = Trajectory(qpos, fps, problem.robot.joint_names, problem.robot.name, source)
    return Solution(
        trajectory,
        tuple(r.status for r in results),
        np.array([r.cost for r in results]),
        errors,
        tuple(edges.labels),
        np.array([r.iterations for r in results]),
        {"solve": time.perf_counter() - began},
    )


@dataclass(frozen=True)
class _Result:
    qpos: Floats
    status: Status
    cost: float
    iterations: int


class _Frame:
    """The solver of single frames; holds the compiled quadratic program."""

    def __init__(self, problem: Problem, options: Options, fps: float):
        self.problem, self.options, self.robot = problem, options, problem.robot
        nv = self.robot.model.nv
        shape = {"h": ca.Sparsity.dense(nv, nv), "a": ca.Sparsity.dense(problem.soles, nv)}
        self.program = ca.conic("program", "daqp", shape, {"error_on_fail": False})
        self.hinges = self.robot.dof_index
        self.inertia = np.zeros(nv)
        self.inertia[self.hinges] = options.smoothness * (fps / 30) ** 4

    def find(self, parameters: tuple[Floats, ...], edges: Edges, frame: int) -> _Result:
        """The best of several starts: the reference pose, the standing pose, and poses drawn within the ranges."""
        starts = [self.robot.neutral(), self.robot.standing()]
        draw = np.random.default_rng(self.options.seed)
        while len(starts) < max(2, self.options.starts):
            pose = self.robot.neutral()
            pose[self.robot.qpos_index] = draw.uniform(0.5 * self.robot.lower, 0.5 * self.robot.upper)
            starts.append(pose)
        placed = [place_root(self.problem, q, edges.root[frame], edges.facing[frame]) for q in starts]
        results = [self.descend(q, parameters, None, 5 * self.options.iterations) for q in placed]
        return self.lifted(min(results, key=lambda r: r.cost))

    def track(self, parameters: tuple[Floats, ...], history: list[Floats]) -> _Result:
        """Continue from the frame before, whose speed the joints would keep."""
        expected = np.zeros(self.robot.model.nv)
        if len(history) == 2:
            expected = difference(self.robot, history[0], history[1])
        return self.lifted(self.descend(history[-1], parameters, (history[-1], expected), self.options.iterations))

    def lifted(self, result: _Result) -> _Result:
        """The result with its root raised by what curvature let a sole sink under the floor."""
        if not (self.robot.floating and self.problem.soles):
            return result
        depth = float(np.asarray(self.problem.heights(result.qpos)).min())
        if depth >= 0:
            return result
        raised = np.array(result.qpos)
        raised[int(self.robot.model.jnt_qposadr[self.robot.root_joints[0]]) + 2] -= depth
        return replace(result, qpos=raised)

    def descend(
        self,
        start: Floats,
        parameters: tuple[Floats, ...],
        inertia: tuple[Floats, Floats] | None,
        iterations: int,
    ) -> _Result:
        """Gauss–Newton steps within the ranges and above the floor until the step is small."""
        q, damping = start, self.options.damping
        cost, gradient, normal, floor, slope = self._model(q, parameters, inertia)
        for count in range(1, iterations + 1):
            step = self._step(q, gradient, normal, floor, slope, damping)
            if step is None:
                return _Result(q, Status.BLOCKED, cost, count)
            trial = integrate(self.robot, q, step)
            moved = self._model(trial, parameters, inertia)
            if moved[0] < cost + 1e-12 or floor.min(initial=0.0) < -1e-4:
                q, damping = trial, max(damping / 4, 1e-6)
                cost, gradient, normal, floor, slope = moved
                if np.abs(step).max() < self.options.tolerance:
                    return _Result(q, Status.CONVERGED, cost, count)
            elif np.abs(step).max() < self.options.tolerance:
                return _Result(q, Status.CONVERGED, cost, count)
            else:
                damping = min(damping * 10 + 1e-4, 1e3)
        return _Result(q, Status.OUT_OF_ITERATIONS, cost, iterations)

    def _model(
        self, q: Floats, parameters: tuple[Floats, ...], inertia: tuple[Floats, Floats] | None
    ) -> tuple[float, Floats, Floats, Floats, Floats]:
        cost, gradient, normal, floor, slope = (np.asarray(v) for v in self.problem.model(q, *parameters))
        total, gradient = float(cost.item()), gradient.ravel()
        if inertia is not None:
            before, expected = inertia
            change = difference(self.robot, before, q) - expected
            total += float(self.inertia @ change**2)
            gradient = gradient + self.inertia * change
            normal = normal + np.diag(self.inertia)
        return total, gradient, normal, floor.ravel(), slope

    def _step(
        self, q: Floats, gradient: Floats, normal: Floats, floor: Floats, slope: Floats, damping: float
    ) -> Floats | None:
        """The step that minimises the quadratic model within ranges, trust region and floor."""
        nv = len(gradient)
        lower, upper = np.full(nv, -1.0), np.full(nv, 1.0)
        angle, trust = q[self.robot.qpos_index], self.options.trust
        lower[self.hinges] = np.clip(self.robot.lower - angle, -trust, 0.0)
        upper[self.hinges] = np.clip(self.robot.upper - angle, 0.0, trust)
        answer = self.program(
            h=normal + damping * np.eye(nv), g=gradient, a=slope, lba=-floor, uba=np.inf, lbx=lower, ubx=upper
        )
        step = np.asarray(answer["x"]).ravel()
        return step if self.program.stats()["success"] and np.isfinite(step).all() else None


def place_root(problem: Problem, qpos: Floats, pelvis: Floats, facing: Floats) -> Floats:
    """A pose with its free root turned and moved so that the pelvis has the wished frame and place, feet above ground."""
    robot, anatomy = problem.robot, problem.match.anatomy
    if not robot.floating:
        return qpos
    body, axes = anatomy.frames.get("pelvis", (robot.root_body, np.eye(3)))
    address = int(robot.model.jnt_qposadr[robot.root_joints[0]])
    moved = np.array(qpos)
    positions, rotations = body_frames(robot, moved[None])
    root = rotations[0, robot.root_body]
    turn = facing @ (rotations[0, body] @ axes).T
    spot = anatomy.spots.get("pelvis")
    offset = np.zeros(3) if spot is None else positions[0, spot.body] + rotations[0, spot.body] @ spot.offset
    moved[address + 3 : address + 7] = Rotation.from_matrix(turn @ root).as_quat(scalar_first=True)
    moved[address : address + 3] = pelvis - turn @ (offset - positions[0, robot.root_body])
    return moved
