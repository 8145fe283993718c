"""Rigidity against graphs whose answer is known."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from small_graphs import graph_of

from robot_retarget.base.errors import GraphError
from robot_retarget.human.match import paths
from robot_retarget.papers import Sensing, Team, adapt, bone_edges, formation_rigidity, frame_edges
from robot_retarget.papers.rigidity import (
    admits,
    congruent,
    globally_rigid,
    isometric,
    locally_rigid,
    rigidity_matrix,
    stress_matrix_rank,
)
from robot_retarget.papers.skeletal import structure_from_pose, table_one_body

RNG = np.random.default_rng(5)
CYCLE = [(0, 1), (1, 2), (2, 3), (0, 3)]
PRISM = [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 3), (1, 4), (2, 5)]
TWO_TETRAHEDRA = [pair for pair in combinations(range(5), 2) if pair != (3, 4)]


def rank(positions: np.ndarray, edges: Any) -> int:
    return int(np.linalg.matrix_rank(rigidity_matrix(positions, edges), rtol=1e-9))


def complete(count: int) -> list[tuple[int, int]]:
    return list(combinations(range(count), 2))


@pytest.mark.parametrize(
    ("edges", "count", "dimension", "expected_rank", "local", "unique"),
    [
        (CYCLE, 4, 2, 4, False, False),
        ([*CYCLE, (0, 2)], 4, 2, 5, True, False),
        (complete(4), 4, 2, 5, True, True),
        (PRISM, 6, 2, 9, True, False),
        ([pair for pair in complete(4) if pair != (2, 3)], 4, 3, 5, False, False),
        (complete(4), 4, 3, 6, True, True),
        (TWO_TETRAHEDRA, 5, 3, 9, True, False),
        (complete(5), 5, 3, 9, True, True),
    ],
    ids=["4-cycle", "with diagonal", "K4 in the plane", "prism", "two triangles", "K4", "two tetrahedra", "K5"],
)
def test_known_frameworks(
    edges: list[tuple[int, int]], count: int, dimension: int, expected_rank: int, local: bool, unique: bool
) -> None:
    assert rank(RNG.normal(size=(count, dimension)), edges) == expected_rank
    assert locally_rigid(edges, count, dimension) is local
    assert globally_rigid(edges, count, dimension) is unique


def test_stress_matrix_of_the_complete_square_has_rank_one() -> None:
    assert stress_matrix_rank(complete(4), 4, 2) == 1
    assert stress_matrix_rank(CYCLE, 4, 2) == 0


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


def test_congruent_bodies_are_isometric_but_not_the_other_way_round() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    rhombus = np.array([[0, 0], [1, 0], [1.6, 0.8], [0.6, 0.8]])
    assert isometric(square, rhombus, CYCLE)
    assert not congruent(square, rhombus)
    mirrored = square * [1, -1] + 3
    assert congruent(square, mirrored)
    assert isometric(square, mirrored, CYCLE)


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


def test_graph_admits_a_structure_only_if_every_frame_does() -> None:
    structure = structure_from_pose(("a", "b", "c"), [-1, 0, 1], [[0, 0], [1, 0], [1, 2]])
    x = np.tile(structure.initial_pose, (3, 1, 1)) + np.arange(3)[:, None, None]
    graph = frame_edges(("a", "b", "c", "d"), np.concatenate([x, RNG.normal(size=(3, 1, 2))], axis=1))
    assert admits(graph, structure)
    bone = next(edge for edge in range(len(graph.edges)) if graph.edges.name(edge) == "a@1–b@1")
    assert not admits(graph.select(np.arange(len(graph.edges)) != bone), structure)
    assert not admits(graph, structure.scaled([1, 1, 1.1]))
    assert not admits(graph.induced([0, 1], 0, 2), structure)


def test_adapted_graph_admits_the_target_body_and_not_the_source() -> None:
    source = table_one_body()
    target = source.scaled(np.linspace(0.8, 1.3, 22))
    graph = adapt(np.stack([source.initial_pose] * 3), source, target)
    assert admits(graph, target)
    assert not admits(graph, source)
    assert admits(bone_edges(graph, source), source)


def test_edge_outside_the_vertices_is_named() -> None:
    with pytest.raises(GraphError, match=r"edge 1 joins \[1, 7\]: two different vertices of 0 … 3"):
        locally_rigid([(0, 1), (1, 7)], 4, 2)


def test_one_missing_distance_makes_the_postures_flexible() -> None:
    graph = graph_of("abcd", "ab bc cd da ac", 1.0)
    edges = np.stack([graph.edges.i, graph.edges.j], axis=1)
    assert locally_rigid(edges, 4, 2)
    assert not any(locally_rigid(np.delete(edges, edge, axis=0), 4, 2) for edge in range(5))
