"""The quadratic program of a frame against its own optimality."""

import numpy as np
import pytest

from robot_retarget.base.arrays import Floats
from robot_retarget.solver.compiled import QuadraticPrograms


def minimiser(h: Floats, g: Floats, a: Floats, least: Floats, lower: Floats, upper: Floats) -> Floats | None:
    one = (np.asarray(each)[None] for each in (h, g, lower, upper, a, least))
    found, kept = QuadraticPrograms(len(g)).solve(*one)
    return found[0] if kept[0] else None


@pytest.mark.parametrize("seed", range(20))
def test_no_feasible_direction_lowers_the_program(seed: int) -> None:
    draw = np.random.default_rng(seed)
    root = draw.normal(size=(8, 5))
    h, g, a = root.T @ root + 0.1 * np.eye(5), draw.normal(size=5) * 3, draw.normal(size=(4, 5))
    least, lower, upper = -np.abs(draw.normal(size=4)) * 0.2, np.full(5, -0.5), np.full(5, 0.5)
    x = minimiser(h, g, a, least, lower, upper)
    assert x is not None
    for other in draw.uniform(-0.5, 0.5, size=(2000, 5)):
        if (a @ other >= least).all():
            assert (h @ x + g) @ (other - x) > -1e-7


def test_stiff_programs_are_solved_within_their_bounds() -> None:
    for seed in range(100):
        draw = np.random.default_rng(seed)
        rows = draw.normal(size=(30, 30)) * np.repeat([300.0, 1.0], [20, 10])[:, None]
        h, g = rows.T @ rows + 1e-3 * np.eye(30), -rows.T @ (rows @ draw.normal(size=30) * 2)
        a, least, half = draw.normal(size=(4, 30)), -np.abs(draw.normal(size=4)) * 0.2, np.full(30, 0.5)
        x = minimiser(h, g, a, least, -half, half)
        assert x is not None and (np.abs(x) <= half).all() and (a @ x >= least - 1e-5).all()


def test_a_program_without_a_solution_says_so() -> None:
    a, one = np.array([[1.0, 0.0]]), np.ones(2)
    assert minimiser(np.eye(2), one, a, np.array([5.0]), -one, one) is None
