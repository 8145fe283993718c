"""The rigidity matrix and the eigenvalue of a formation."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from robot_retarget.human.match import paths
from robot_retarget.papers import Sensing, Team, formation_rigidity
from robot_retarget.papers.formation import rigidity_matrix
from robot_retarget.papers.skeletal import table_one_body

RNG = np.random.default_rng(5)
PRISM = [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 3), (1, 4), (2, 5)]


def rank(positions: np.ndarray, edges: Any) -> int:
    return int(np.linalg.matrix_rank(rigidity_matrix(positions, edges), rtol=1e-9))


def complete(count: int) -> list[tuple[int, int]]:
    return list(combinations(range(count), 2))


@pytest.mark.parametrize(
    ("bones", "expected_generic", "expected_walking"), [(1, 21, 21), (2, 44, 44), (3, 60, 59), (4, 60, 60)]
)
def test_body_of_table_one_is_rigid_with_paths_of_four_bones(
    bones: int, expected_generic: int, expected_walking: int
) -> None:
    body = table_one_body()
    hops = paths(body.parents).sum(axis=2)
    edges = np.argwhere(np.triu((hops >= 1) & (hops <= bones)))
    # The walking posture holds the spine in one plane, which costs the paths of three bones a rank.
    assert rank(body.initial_pose, edges) == expected_walking
    assert rank(RNG.normal(size=(22, 3)), edges) == expected_generic


def test_rigidity_matrix_is_the_derivative_of_the_squared_lengths() -> None:
    x = RNG.normal(size=(6, 2))
    matrix, step = rigidity_matrix(x, PRISM), 1e-6
    for place in range(12):
        move = np.zeros(12)
        move[place] = step
        ends = [x + sign * move.reshape(6, 2) for sign in (1, -1)]
        squares = [np.array([((y[a] - y[b]) ** 2).sum() for a, b in PRISM]) for y in ends]
        np.testing.assert_allclose(matrix[:, place], (squares[0] - squares[1]) / (4 * step), atol=1e-8)


def test_eigenvalue_vanishes_where_links_are_lost() -> None:
    squares = RNG.normal(size=(3, 4, 2))
    squares[1, 3] += 100.0
    team = Team(np.arange(4), np.zeros(0, int), Sensing(near=20.0, far=30.0), least=0.1)
    values = formation_rigidity(team, squares)
    assert abs(values[1]) < 1e-12
    for frame in (0, 2):
        matrix = rigidity_matrix(squares[frame], complete(4))
        assert values[frame] == pytest.approx(np.linalg.eigvalsh(matrix.T @ matrix)[3])
        assert values[frame] > 1e-3
    bodies = Team(np.arange(5), np.zeros(0, int), Sensing(near=20.0, far=30.0), least=0.1)
    assert formation_rigidity(bodies, RNG.normal(size=(1, 5, 3)))[0] > 1e-3
