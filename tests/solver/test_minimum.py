"""The minimum of a whole clip: the banded matrix, the program of a step, and the path that the steps reach."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.graph.track import SECOND_DIFFERENCE, THIRD_DIFFERENCE, Status
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solver import clip_step, minimum
from robot_retarget.solver.banded import BandedSystem, DifferenceCosts, FrameCoupling
from robot_retarget.solver.clip import stresses
from robot_retarget.solver.clip_step import ABSENT, Room, StepProgram, StepRows
from robot_retarget.solver.limits import Differences, targets_of
from robot_retarget.solver.minimum import ClipMinimum
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import problem_of, solve_graph
from robot_retarget.solver.sqp import FrameSolver

OP3 = rr.load_robot("op3")


def drawn_differences(draw: np.random.Generator, frames: int, directions: int) -> list[DifferenceCosts]:
    return [
        DifferenceCosts.of(
            order,
            Differences(
                draw.uniform(0.1, 9.0, (frames, directions)), draw.normal(size=(frames, directions)), np.ones(1)
            ),
            frames,
        )
        for order in (2, 3)
    ]


@settings(max_examples=25)
@given(st.integers(1, 9), st.integers(1, 4), st.integers(0, 3), st.integers(0, 10**6))
def test_the_banded_matrix_is_that_of_the_differences(frames: int, directions: int, fixed: int, seed: int) -> None:
    draw, fixed = np.random.default_rng(seed), min(fixed, frames - 1)
    costs = drawn_differences(draw, frames, directions)

    def of_path(path: np.ndarray) -> tuple[float, np.ndarray]:
        cost, gradient = np.zeros(frames), np.zeros((frames, directions))
        for each in costs:
            each.added(np.diff(path, axis=0), cost, gradient)
        return float(cost.sum()), gradient

    path, moved = draw.normal(size=(2, frames, directions))
    moved[:fixed] = 0.0
    coupling = FrameCoupling(costs, frames, directions).after(fixed)
    (before, slope), (after, _) = of_path(path), of_path(path + moved)
    bent = float((moved[fixed:] * (coupling @ moved[fixed:])).sum())
    assert after == pytest.approx(before + 2 * float((slope * moved).sum()) + bent)

    roots = draw.normal(size=(frames - fixed, directions, directions))
    blocks, right = roots @ roots.swapaxes(1, 2) + np.eye(directions), draw.normal(size=(frames - fixed, directions))
    system = BandedSystem(frames - fixed, directions, len(coupling.diagonals) - 1)
    full = blocks.copy()
    full.reshape(len(full), -1)[:, :: directions + 1] += coupling.diagonals[0]
    system.factor(full, coupling.diagonals[1:])
    x = system.solve(right)
    np.testing.assert_allclose((blocks @ x[..., None])[..., 0] + coupling @ x, right, atol=1e-8)


@pytest.mark.parametrize("seed", range(6))
def test_the_step_of_a_clip_is_the_minimum_of_a_dense_program(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """DAQP, an active-set solver, solves the same program with a variable for every slack."""
    draw, frames, directions, count = np.random.default_rng(seed), 7, 4, 3
    hinges, scale = np.array([1, 2, 3]), 0.3
    coupling = FrameCoupling(drawn_differences(draw, frames, directions), frames, directions)
    roots = draw.normal(size=(frames, directions, directions))
    normal, gradient = roots @ roots.swapaxes(1, 2), draw.normal(size=(frames, directions))
    rows = StepRows(
        draw.normal(size=(frames, count, directions)),
        draw.normal(scale=scale, size=(frames, count)),
        np.full((frames, count), 1e4),
        np.tile([False, True, True], (frames, 1)),
        shared=2e4,
    )
    rows.lower[:, -1] = -ABSENT
    size, changes = (frames, directions), (frames, len(hinges))
    room = Room(
        -draw.uniform(0, scale, size),
        draw.uniform(0, scale, size),
        -draw.uniform(0, scale, changes),
        draw.uniform(0, scale, changes),
        hinges,
    )
    room.slower[0], room.faster[0] = -ABSENT, ABSENT
    monkeypatch.setattr(clip_step, "NEWTON", 25)
    monkeypatch.setattr(clip_step, "RELATIVE_GAP", 1e-8)
    program = StepProgram(gradient, normal, coupling, rows, room)
    step, gained, _ = program.minimised(BandedSystem(frames, directions, 3), 10.0, 0.0)

    n = frames * directions
    unit = np.eye(n).reshape(n, frames, directions)
    hessian = np.array([program._times(each).ravel() for each in unit])
    every = np.array([program._constrained(each) for each in unit]).T
    joint = np.zeros((len(every), frames))
    joint[: rows.links.size] = np.repeat(np.eye(frames), count, axis=0) * rows.links.reshape(-1, 1)
    h = np.zeros((n + len(every) + frames,) * 2)
    h[:n, :n] = hessian
    h[n:, n:] = np.diag(np.append(1 / program.give, np.full(frames, rows.shared)))
    side = {"h": ca.DM(2 * h), "a": ca.DM(np.hstack([every, np.eye(len(every)), joint]))}
    conic = ca.conic("dense", "daqp", {name: each.sparsity() for name, each in side.items()})
    linear = np.append(2 * gradient.ravel(), np.zeros(len(h) - n))
    found = conic(**side, g=ca.DM(linear), lba=ca.DM(program.lower))
    assert -float(found["cost"]) + program._penalty(np.zeros(size)) == pytest.approx(gained, rel=0.02)
    np.testing.assert_allclose(np.array(found["x"]).ravel()[:n], step.ravel(), atol=1e-3 * scale)


@pytest.mark.parametrize("barrier", [1e-9, 1e-3, 10.0])
def test_a_program_starts_inside_its_constraints_where_links_are_deep_in_each_other(barrier: float) -> None:
    """Three links 24 mm deep in each other, whose slacks are 10,000 times smaller, and forces of some 10⁴."""
    draw, directions, count = np.random.default_rng(0), 3, 5
    lower = np.array([[-ABSENT, 0.022694, 0.0244505, 0.0244555, 0.0244732]])
    rows = StepRows(
        draw.normal(size=(1, count, directions)), lower, np.full((1, count), 2e7), np.ones((1, count), bool), 2e7
    )
    size, hinges = (1, directions), np.array([2])
    room = Room(-np.ones(size), np.ones(size), -np.ones((1, 1)), np.ones((1, 1)), hinges)
    coupling = FrameCoupling([], 1, directions)
    program = StepProgram(np.ones(size), np.eye(directions)[None], coupling, rows, room)
    force, slack = program._start(barrier)
    assert (force > 0).all() and (slack > 0).all()
    assert (force * slack > (1 - 1e-9) * barrier).all()
    missed = np.abs(program._given(force) - slack - program.lower).max()
    assert missed < 0.0244732 / 200  # 12 bits of the logarithm of an interval of 1 to 10 million
    step, gained, _ = program.minimised(BandedSystem(1, directions, 1), barrier * len(force), 1e-9)
    assert np.isfinite(step).all() and gained > 0


def clip_graph(name: str, robot: rr.Robot, first: int, last: int) -> rr.RobotGraph:
    return rr.describe(rr.read_motion(ROOT / f"samples/{name}.bvh").frames(first, last), robot).unbalanced()


def test_every_frame_of_a_sample_converges() -> None:
    assert set(solve_graph(clip_graph("wave", OP3, 60, 110)).status) == {Status.CONVERGED}


@pytest.fixture(scope="module", params=["walk", "wave"])
def solved(request: pytest.FixtureRequest) -> tuple[rr.RobotGraph, Any, Solution]:
    graph = clip_graph(request.param, OP3, 0, 90)
    problem = problem_of(graph)
    return graph, problem, solve_graph(graph, problem=problem)


def test_another_solve_from_the_result_changes_it_by_nothing_that_counts(
    solved: tuple[rr.RobotGraph, Any, Solution],
) -> None:
    graph, problem, solution = solved
    again = solve_graph(graph, problem=problem, start=solution.trajectory.qpos)
    assert solution.cost.sum() < 1.002 * again.cost.sum()


def test_more_steps_lower_the_cost_by_half_a_percent_at_most(solved: tuple[rr.RobotGraph, Any, Solution]) -> None:
    graph, problem, solution = solved
    longer = solve_graph(graph, problem=problem, smoothing=Smoothing(steps=40, gain=1e-5))
    assert solution.cost.sum() < 1.005 * longer.cost.sum()


def test_no_line_search_along_a_random_direction_lowers_the_cost(solved: tuple[rr.RobotGraph, Any, Solution]) -> None:
    _, problem, solution = solved
    solver, qpos, draw = FrameSolver(problem), solution.trajectory.qpos, np.random.default_rng(0)
    angles, step = qpos[:, OP3.qpos_index], 1e-3
    free = np.ones((len(qpos), OP3.model.nv), dtype=bool)
    inside = (angles > OP3.lower + 2 * step) & (angles < OP3.upper - 2 * step)
    free[:, OP3.dof_index] = inside

    def cost(moved: np.ndarray) -> float:
        return float(sum(each.sum() for each in stresses(solver, solution.graph, integrate(OP3, qpos, moved)).values()))

    base = cost(np.zeros(free.shape))
    for _ in range(8):
        way = draw.normal(size=free.shape) * free * (draw.random(OP3.model.nv) < 0.2)
        ahead, behind = cost(step * way), cost(-step * way)
        gain = (ahead - behind) ** 2 / (8 * max(ahead + behind - 2 * base, 1e-12))
        assert gain < 1e-3 * base


@pytest.mark.parametrize(
    ("clip", "most"), [("walk", (22, 17, 40, 6)), ("wave", (24, 14, 43, 5)), ("clap", (44, 21, 90, 8))]
)
def test_the_work_of_a_sample_does_not_grow(clip: str, most: tuple[int, ...]) -> None:
    """Counts per frame, which depend on no clock: a tenth above those of the day on which they were recorded."""
    work = solve_graph(rr.describe(rr.read_motion(ROOT / f"samples/{clip}.bvh"), OP3).unbalanced()).work
    for count, limit in zip(("linearised", "measured", "factorised", "programs"), most, strict=True):
        assert work[count] <= limit


def test_after_a_shortened_step_the_model_of_every_frame_is_that_of_its_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hands that meet refuse steps; frames away from them are not linearised again."""
    shortened, checked, accept, shares = [0], [0], ClipMinimum._accept, minimum._shares

    def counted(*given: Any) -> Any:
        shortened[0] += 1
        return shares(*given)

    def accepted(self: ClipMinimum, step: np.ndarray) -> float:
        before = shortened[0]
        gained = accept(self, step)
        if gained and shortened[0] > before:
            _, gradient, normal = self.clip.solver.problem.model(self.qpos, self.clip.all_targets)
            np.testing.assert_allclose(self.model.frames.gradient, gradient, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(self.model.frames.normal, normal, rtol=1e-9, atol=1e-9)
            checked[0] += 1
        return gained

    monkeypatch.setattr(minimum, "_shares", counted)
    monkeypatch.setattr(ClipMinimum, "_accept", accepted)
    solve_graph(rr.describe(rr.read_motion(ROOT / "samples/clap.bvh").frames(80, 120), OP3).unbalanced())
    assert checked[0] > 0


ROBOTS: dict[str, Callable[[], rr.Robot]] = {
    "op3": lambda: OP3,
    "g1": lambda: rr.load_robot(SHARED / "robots/unitree_g1/unitree_g1.xml"),
}


@needs_shared
@pytest.mark.parametrize(("name", "clip"), [("op3", "wave"), ("g1", "walk")])
def test_ipopt_on_the_whole_nonlinear_program_ends_at_the_same_cost(name: str, clip: str) -> None:
    """All frames, ranges, speeds, footholds and the floor as one program of CasADi, from the same start."""
    graph = clip_graph(clip, ROBOTS[name](), 40, 50).without("separation")
    problem = problem_of(graph)
    solution = solve_graph(graph, problem=problem, smoothing=Smoothing(steps=60, gain=1e-7))
    found = ipopt(solution, problem, solve_graph(graph, problem=problem, smoothing=Smoothing(steps=0)).trajectory.qpos)
    assert solution.cost.sum() == pytest.approx(found, rel=2e-3)


def ipopt(solution: Solution, problem: Any, start: np.ndarray) -> float:
    """Return the least cost of the solution's targets that IPOPT finds from a path (T, nq)."""
    graph, robot = solution.graph, solution.graph.robot
    targets, limits, nv = targets_of(graph.tracks), problem.limits, robot.model.nv
    v = ca.MX.sym("v", nv, len(start))
    path = [moved(robot, start[t], v[:, t]) for t in range(len(start))]
    cost, rows, low, high = ca.MX(0), [], [], []
    for t, q in enumerate(path):
        for part in problem.parts:
            sides = part.of(targets.at(t))
            cost += part.build.functions[0]._serves._function(q, *map(ca.DM, sides))[0]
        if len(problem.inequalities):
            values = problem.inequalities._measure._serves._function(q)[0]
            rows.append(values)
            low.append(targets.lower[t, problem.inequalities.edges])
            high.append(np.full(values.numel(), np.inf))
    speed = [turned(robot, a, b) for a, b in pairwise(path)]
    for order, stencil in ((2, SECOND_DIFFERENCE), (3, THIRD_DIFFERENCE)):
        each = DifferenceCosts.of(order, limits.differences(targets, stencil), len(start))
        for k in range(len(start) - order):
            bent = sum(float(c) * speed[k + i] for i, c in enumerate(np.diff(np.eye(order), order - 1, axis=0)[0]))
            cost += ca.dot(ca.DM(each.weight[k]), (bent - ca.DM(each.bend[k])) ** 2)
    bounds = limits.bounds(targets)
    for t in range(1, len(start)):
        rows.append(speed[t - 1][robot.dof_index.tolist()])
        low.append(-bounds.speed[t] / graph.fps)
        high.append(bounds.speed[t] / graph.fps)
    below, above = (np.full((len(start), nv), sign * np.inf) for sign in (-1, 1))
    below[:, robot.dof_index] = bounds.lower - start[:, robot.qpos_index]
    above[:, robot.dof_index] = bounds.upper - start[:, robot.qpos_index]
    quiet = {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-6, "hessian_approximation": "limited-memory"}
    solver = ca.nlpsol(
        "whole", "ipopt", {"x": ca.vec(v), "f": cost, "g": ca.vertcat(*rows)}, {"print_time": False, "ipopt": quiet}
    )
    found = solver(x0=0, lbx=below.ravel(), ubx=above.ravel(), lbg=np.concatenate(low), ubg=np.concatenate(high))
    return float(found["f"])


def moved(robot: rr.Robot, q: np.ndarray, v: ca.MX) -> ca.MX:
    """q ⊕ v of a robot with a free root, as an expression."""
    w = v[3:6] / 2
    half = ca.sqrt(ca.sumsqr(w) + 1e-16)
    step = ca.vertcat(ca.cos(half), ca.sin(half) / half * w)
    a, b = ca.DM(q[3:7]), step
    turned = ca.vertcat(a[0] * b[0] - ca.dot(a[1:4], b[1:4]), a[0] * b[1:4] + b[0] * a[1:4] + ca.cross(a[1:4], b[1:4]))
    return ca.vertcat(ca.DM(q[:3]) + v[:3], turned, ca.DM(q[7:]) + v[6:])


def turned(robot: rr.Robot, a: ca.MX, b: ca.MX) -> ca.MX:
    """The tangent vector from one configuration to another, as an expression."""
    p, q = a[3:7], b[3:7]
    w = ca.dot(p, q)
    u = p[0] * q[1:4] - q[0] * p[1:4] - ca.cross(p[1:4], q[1:4])
    sine = ca.sqrt(ca.sumsqr(u) + 1e-16)
    return ca.vertcat(b[:3] - a[:3], 2 * ca.atan2(sine, w) / sine * u, b[7:] - a[7:])
