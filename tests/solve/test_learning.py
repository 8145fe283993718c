"""Descents that learn the curvature from their own steps end where exact ones do, in fewer steps."""

from functools import cache

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.problem import build_problem, frame_parameters
from robot_retarget.solve.starts import ways


@cache
def waving() -> tuple[FrameSolver, list[tuple[Floats, ...]], list[Floats]]:
    """A solver, what some neighbouring frames wish, and where exact descents end from one to the next."""
    motion, robot = read_motion(SAMPLES / "wave.bvh").resample(30).frames(20, 60), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    free = solver.grip.lay_down(np.zeros((2, 4), dtype=bool))
    wished = [(*frame_parameters(edges, t), *free) for t in range(len(edges))]
    exact = [ways(solver, wished[0], edges, 0)[0].qpos]
    for wish in wished:
        exact.append(solver.descend(exact[-1], wish, tolerance=1e-10, iterations=100).qpos)
    return solver, wished, exact


def descended(learning: bool) -> tuple[float, int]:
    """How far descents from the exact end of the frame before miss their own, as a mean [rad], in how many steps."""
    solver, wished, exact = waving()
    ends = [solver.descend(q, wish, learning=learning) for q, wish in zip(exact, wished, strict=False)]
    missed = [np.abs(difference(solver.robot, end.qpos, q)).max() for end, q in zip(ends, exact[1:], strict=True)]
    return float(np.mean(missed)), sum(end.iterations for end in ends)


def test_the_model_after_a_step_tells_how_the_gradient_changed() -> None:
    solver, wished, exact = waving()
    q, draw = exact[1], np.random.default_rng(0)
    for _ in range(20):
        step = draw.normal(scale=0.02, size=solver.robot.model.nv)
        before = solver.landscape.around(q, wished[0])
        there = solver.landscape.around(integrate(solver.robot, q, step), wished[0])
        after = there.after(step, before)
        if after is not there:
            assert np.allclose(after.normal @ step, there.gradient - before.gradient, rtol=1e-9, atol=1e-9)
        assert np.linalg.eigvalsh(after.normal).min() > -1e-9 * np.abs(after.normal).max()


def test_learning_descents_end_nearer_the_optimum_in_fewer_steps() -> None:
    (learned, few), (plain, many) = descended(learning=True), descended(learning=False)
    assert learned < 0.6 * plain and few < 0.8 * many
