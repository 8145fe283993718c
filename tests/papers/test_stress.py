"""The printed objectives, their gradients and invariances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from small_graphs import graph_of, of_kind

from robot_retarget.graph.track import LEAST_DISTANCE
from robot_retarget.papers import (
    Interaction,
    Objective,
    PointGraph,
    distances,
    frame_edges,
    interaction_distance,
    stress,
)
from robot_retarget.papers.edges import INTERACTION
from robot_retarget.papers.evaluation import errors, gradient, relative_errors

NAMES = tuple("abcdefg")


def random_graph(rng: np.random.Generator, frames: int = 3, dimension: int = 3) -> tuple[PointGraph, np.ndarray]:
    """Exact, interval, one-sided and interaction edges between a few objects, and a realization that misses them."""
    x = rng.normal(size=(frames, len(NAMES), dimension))
    graph = frame_edges(NAMES, x, 1.0)
    lower = graph.edges.lower * rng.uniform(0.5, 1.2, len(graph.edges))
    width = np.where(rng.random(len(graph.edges)) < 0.5, 0.0, rng.uniform(0, 0.5, len(graph.edges)))
    upper = np.where(rng.random(len(graph.edges)) < 0.2, np.inf, lower + width)
    late = (np.arange(len(graph.edges)) >= 21) & (rng.random(len(graph.edges)) < 0.4)
    graph = graph.with_targets(lower=lower, upper=upper, priority=rng.uniform(0.01, 2, len(graph.edges)))
    moving = of_kind(graph.select(late), INTERACTION)
    return replace(graph.select(~late).joined(moving), interaction=Interaction(5)), x


def test_squared_is_twice_half_squared() -> None:
    graph, x = random_graph(np.random.default_rng(0))
    assert stress(graph, x, Objective.SQUARED) == pytest.approx(2 * stress(graph, x, Objective.HALF_SQUARED), rel=1e-14)


def test_relative_stress_of_unit_priorities_is_edges_times_mean_error() -> None:
    graph, x = random_graph(np.random.default_rng(1))
    graph = graph.with_targets(priority=1.0)
    mean = relative_errors(graph, x).mean()
    assert stress(graph, x, Objective.RELATIVE) == pytest.approx(len(graph.edges) * mean, rel=1e-13)


def test_half_squared_is_the_printed_sum() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=(2, 5, 2))
    graph = frame_edges(NAMES[:5], x, np.arange(1.0, 11.0))
    total = 0.0
    for edge in range(10):
        apart = np.sqrt(sum((y[graph.edges.i[edge]] - y[graph.edges.j[edge]]) ** 2))
        total += 0.5 * (edge + 1) * (apart - graph.edges.lower[edge]) ** 2
    assert stress(graph, y, Objective.HALF_SQUARED) == pytest.approx(total, rel=1e-13)


@pytest.mark.parametrize("objective", list(Objective))
@pytest.mark.parametrize("dimension", [2, 3])
def test_gradient_meets_finite_differences(objective: Objective, dimension: int) -> None:
    graph, x = random_graph(np.random.default_rng(3), dimension=dimension)
    step = 1e-6
    exact = gradient(graph, x, objective).ravel()
    numeric = np.empty_like(exact)
    for place in range(x.size):
        move = np.zeros(x.size)
        move[place] = step
        move = move.reshape(x.shape)
        numeric[place] = (stress(graph, x + move, objective) - stress(graph, x - move, objective)) / (2 * step)
    np.testing.assert_allclose(exact, numeric, rtol=1e-7, atol=1e-7)


def test_interaction_edges_measure_the_interaction_distance() -> None:
    graph, x = random_graph(np.random.default_rng(4))
    chosen = graph.edges.kind == "interaction"
    assert chosen.any()
    expected, _ = interaction_distance(x[:-1], x[1:], horizon=5)
    frame, a = np.divmod(graph.edges.i[chosen], 7)
    pair = [
        list(zip(*np.triu_indices(7, 1), strict=True)).index(ends)
        for ends in zip(a, graph.edges.j[chosen] % 7, strict=True)
    ]
    np.testing.assert_allclose(distances(graph, x)[chosen], expected[frame - 1, pair], rtol=1e-13)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    turn=arrays(float, 3, elements=st.floats(-3, 3)),
    shift=arrays(float, 3, elements=st.floats(-5, 5)),
)
def test_rigid_motions_leave_the_stress(seed: int, turn: np.ndarray, shift: np.ndarray) -> None:
    graph, x = random_graph(np.random.default_rng(seed))
    # Rounding may flip the steps ahead of an interaction edge only where both choices are equally far.
    moved = x @ Rotation.from_rotvec(turn).as_matrix().T + shift
    assert stress(graph, moved) == pytest.approx(stress(graph, x), rel=1e-9)


@pytest.mark.parametrize("objective", list(Objective))
def test_reflection_leaves_the_stress_to_the_last_bit(objective: Objective) -> None:
    graph, x = random_graph(np.random.default_rng(5))
    assert stress(graph, x * [1, -1, 1], objective) == stress(graph, x, objective)


def test_zero_priority_removes_the_edge() -> None:
    graph, x = random_graph(np.random.default_rng(6))
    silent = graph.with_targets(priority=np.where(np.arange(len(graph.edges)) % 2, graph.edges.priority, 0.0))
    kept = graph.select(np.arange(len(graph.edges)) % 2 == 1)
    assert stress(silent, x) == pytest.approx(stress(kept, x), rel=1e-14)
    np.testing.assert_allclose(gradient(silent, x), gradient(kept, x), atol=1e-13)


def test_distances_inside_their_interval_cost_nothing() -> None:
    graph, x = random_graph(np.random.default_rng(8))
    d = distances(graph, x)
    wide = graph.with_targets(lower=0.5 * d, upper=1.5 * d)
    assert all(stress(wide, x, objective) == 0.0 for objective in Objective)
    assert not gradient(wide, x).any()


def test_coincident_pair_pulls_nowhere() -> None:
    graph = graph_of("ab", "ab", 1.0)
    assert not gradient(graph, np.zeros((2, 2))).any()


def test_contact_distance_zero_has_a_finite_relative_stress() -> None:
    graph = graph_of("ab", "ab", 0.0)
    x = np.array([[0.0, 0.0], [0.01, 0.0]])
    assert stress(graph, x, Objective.RELATIVE) == pytest.approx(0.01 / LEAST_DISTANCE)
    assert stress(graph, x, Objective.RELATIVE_SQUARED) == pytest.approx((0.01 / LEAST_DISTANCE) ** 2)


def test_errors_are_negative_where_a_pair_is_too_close() -> None:
    graph = graph_of("abc", "ab ac", 1.0, 2.0)
    np.testing.assert_allclose(errors(graph, [[0, 0], [0.25, 0], [0, 5]]), [-0.75, 3.0])


def test_one_frame_is_the_ordinary_problem() -> None:
    rng = np.random.default_rng(9)
    x, y = rng.normal(size=(2, 7, 3))
    static, dynamic = frame_edges(NAMES, x), frame_edges(NAMES, np.stack([x, x, x])).at_frame(1)
    assert stress(static, y) == stress(dynamic, y[None])
    np.testing.assert_array_equal(gradient(static, y), gradient(dynamic, y[None]))
