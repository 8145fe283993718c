"""The solvers: what they return, and that they agree."""

from dataclasses import replace

import numpy as np
import pytest
from small_graphs import graph_of, of_kind, table

from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.graph.track import Status
from robot_retarget.papers import (
    Interaction,
    Ipopt,
    Objective,
    Spectral,
    distances,
    frame_edges,
    multistart,
    pair_edges,
    solve,
    solve_frames,
    solve_with_thresholds,
    stress,
    trace_edges,
)
from robot_retarget.papers.edges import BONE, INTERACTION, PointKind
from robot_retarget.papers.evaluation import gradient
from robot_retarget.papers.spectral import Single, minimise

RNG = np.random.default_rng(21)
NAMES = tuple("abcdefgh")
TIGHT = Spectral(value_tolerance=1e-18, step_tolerance=1e-9)


def wide_graph(dimension: int = 3):
    """Interval and exact edges that cannot all be met, and a start."""
    x = RNG.normal(size=(8, dimension))
    graph = frame_edges(NAMES, x, RNG.uniform(0.1, 1, 28))
    lower = graph.edges.lower * RNG.uniform(0.8, 1.2, 28)
    return graph.with_targets(lower=lower, upper=lower * np.where(RNG.random(28) < 0.5, 1.0, 1.1)), x


@pytest.mark.parametrize("objective", [Objective.SQUARED, Objective.HALF_SQUARED, Objective.RELATIVE_SQUARED])
@pytest.mark.parametrize("dimension", [2, 3])
def test_all_methods_reach_one_minimum(objective: Objective, dimension: int) -> None:
    graph, x = wide_graph(dimension)
    reduced = solve(graph, x, TIGHT, objective)
    second = solve(graph, x, Ipopt(()), objective)
    assert reduced.stress > 1e-4 and second.converged
    assert second.stress == pytest.approx(reduced.stress, rel=1e-6)


def test_minima_have_no_gradient() -> None:
    graph, x = wide_graph()
    assert np.abs(gradient(graph, solve(graph, x, Ipopt((), tolerance=1e-12)).positions)).max() < 1e-8


def test_solution_judges_itself() -> None:
    graph = graph_of("abc", "ab bc ac", [1.0, 1.0, 3.0])
    solution = solve(graph, [[0, 0], [1, 0.1], [2, 0]], Ipopt(()))
    third = 1 / 3
    np.testing.assert_allclose(np.abs(solution.errors), third, atol=1e-6)
    assert solution.largest_error == pytest.approx(third, abs=1e-6)
    assert solution.relative_errors.mean() == pytest.approx((third + third + third / 3) / 3, abs=1e-6)
    assert solution.history[0] == pytest.approx(stress(graph, [[0, 0], [1, 0.1], [2, 0]]))
    assert solution.history[-1] == pytest.approx(solution.stress)


def test_iteration_limit_is_reported() -> None:
    graph, x = wide_graph()
    solution = solve(graph, x, Spectral(max_iterations=3))
    assert (solution.status, solution.iterations) == (Status.OUT_OF_ITERATIONS, (3,))
    assert "iterations ran out" in solution.status.value


def test_start_at_the_solution_needs_no_step() -> None:
    x = RNG.normal(size=(8, 3))
    solution = solve(frame_edges(NAMES, x), x)
    assert (solution.status, solution.iterations) == (Status.CONVERGED, (0,))


def test_spectral_method_solves_a_convex_quadratic_in_its_box() -> None:
    matrix = RNG.normal(size=(6, 6))
    hessian, b = matrix @ matrix.T + np.eye(6), RNG.normal(size=6)
    function = Single(lambda z: (float(z @ hessian @ z / 2 - b @ z), hessian @ z - b))
    options = Spectral(value_tolerance=-np.inf, step_tolerance=1e-12)
    free = minimise(function, np.zeros((6, 1)), np.array(-np.inf), np.array(np.inf), options)
    np.testing.assert_allclose(free.z[:, 0], np.linalg.solve(hessian, b), atol=1e-8)
    held = minimise(function, np.zeros((6, 1)), np.array(-0.05), np.array(0.05), options)
    slope = hessian @ held.z[:, 0] - b
    inside = np.abs(held.z[:, 0]) < 0.05
    assert np.abs(slope[inside]).max(initial=0) < 1e-6
    assert (slope[~inside] * held.z[~inside, 0] < 0).all()


def test_fixed_vertices_and_boxes_hold() -> None:
    graph, x = wide_graph()
    fixed = np.zeros((1, 8), dtype=bool)
    fixed[0, :2] = True
    graph = replace(graph, fixed=fixed, box_lower=x - 0.02, box_upper=x + 0.02)
    solution = solve(graph, x)
    np.testing.assert_array_equal(solution.positions[0, :2], x[:2])
    assert np.abs(solution.positions[0] - x).max() <= 0.02 + 1e-15
    hard = solve(graph, x, Ipopt(()))
    np.testing.assert_array_equal(hard.positions[0, :2], x[:2])
    assert solution.stress == pytest.approx(hard.stress, rel=1e-4)


def test_second_order_solves_large_sparse_graphs() -> None:
    jumps = RNG.normal(size=(300, 2, 2))
    shaken = jumps + 0.001 * RNG.normal(size=jumps.shape)
    solution = solve(trace_edges(("a", "b"), jumps, 6), shaken, Ipopt(()))
    assert solution.stress < 1e-15 < stress(solution.graph, shaken)
    assert solution.iterations[0] < 20


def test_multistart_escapes_a_mirrored_start() -> None:
    # b hangs on two anchors and must also be 1 away from d, which only one of the two intersections allows.
    anchors = np.array([[0, 0], [1, 0], [0.5, 1.5]])
    graph = table(("a", "c", "d", "b"), 2, [0, 1, 2], [3, 3, 3], [0.7] * 3, [0.7, 0.7, 1.0101020])
    graph = replace(graph, fixed=np.array([[True, True, True, False]]))
    graph = graph.with_targets(lower=graph.edges.upper, priority=[1, 1, 0.05])
    bad, good = np.vstack([anchors, [0.5, -0.6]]), np.vstack([anchors, [0.5, 0.4]])
    alone = solve(graph, bad)
    best = multistart(graph, [bad, good])
    assert best.stress < 1e-6 < alone.stress
    with pytest.raises(UsageError, match="at least one start"):
        multistart(graph, [])


def test_hard_edges_are_met_to_rounding() -> None:
    bones = of_kind(graph_of("abcd", "ab bc cd", [1.0, 1.0, 1.0]), BONE)
    graph = bones.joined(graph_of("abcd", "ad", [5.0]))
    solution = solve(graph, [[0, 0], [1, 0], [1.5, 0.8], [2.4, 0.5]], Ipopt())
    assert solution.converged
    assert np.abs(solution.errors[:3]).max() < 1e-12
    assert distances(graph, solution.positions)[3] == pytest.approx(3.0, abs=1e-6)


def test_hard_contact_brings_two_points_together() -> None:
    touch = PointKind("touch")
    graph = graph_of("abc", "ab bc", [1.0, 1.5]).joined(of_kind(graph_of("abc", "ac", [0.0]), touch))
    solution = solve(graph, [[0, 0], [1, 0], [0.5, 0.8]], Ipopt([touch]))
    np.testing.assert_allclose(solution.positions[0, 0], solution.positions[0, 2], atol=1e-10)
    assert solution.converged


def test_impossible_hard_edges_are_reported() -> None:
    graph = of_kind(graph_of("abc", "ab bc ac", [1.0, 1.0, 3.0]), BONE)
    solution = solve(graph, [[0, 0], [1, 0.1], [2, 0]], Ipopt(max_iterations=200))
    assert not solution.converged


def test_relative_objective_ignores_one_outlier() -> None:
    x = RNG.normal(size=(8, 3))
    graph = frame_edges(NAMES, x)
    lower = graph.edges.lower.copy()
    lower[5] *= 1.5
    graph = graph.with_targets(lower=lower, upper=lower)
    solution = solve(graph, x + 0.01 * RNG.normal(size=x.shape), Ipopt(()), Objective.RELATIVE)
    np.testing.assert_allclose(np.delete(solution.errors, 5), 0, atol=1e-6)
    assert solution.stress == pytest.approx(1 / 3, abs=1e-6)


def test_relative_objective_is_refused_where_it_has_no_gradient() -> None:
    graph, x = wide_graph()
    with pytest.raises(UsageError, match="use RELATIVE_SQUARED, or Ipopt"):
        solve(graph, x, objective=Objective.RELATIVE)
    with pytest.raises(GraphError, match="is a soft interval"):
        solve(graph, x, Ipopt(()), Objective.RELATIVE)


def test_frames_joined_by_an_edge_cannot_be_solved_apart() -> None:
    walk = RNG.normal(size=(4, 2, 2))
    with pytest.raises(GraphError, match="edge trace 1 a – a joins two frames"):
        solve_frames(trace_edges(("a", "b"), walk), walk)
    posture = frame_edges(("a", "b"), walk)
    twice = solve_frames(posture.joined(posture), 1.1 * walk)
    assert len(twice.errors) == 8 and np.abs(twice.errors).max() < 1e-3


def test_redetected_thresholds_hold_in_every_frame() -> None:
    time = np.linspace(0, 1, 40)[:, None]
    walk = np.stack([np.hstack([time, 0 * time + 0.5]), np.full((40, 2), [0.5, 0.51])], axis=1)
    base = replace(trace_edges(("mover", "rock"), walk), fixed=np.tile([False, True], (40, 1)))
    candidates = pair_edges(base, [("mover", "rock")], 0.2)
    solution = solve_with_thresholds(base, candidates, walk, solve)
    assert distances(candidates, solution.positions).min() >= 0.2 - 1e-4


def test_interaction_edges_push_before_the_meeting() -> None:
    time = np.linspace(0, 1, 30)[:, None]
    walk = np.stack([np.hstack([time, 0.5 + 0 * time]), np.hstack([1 - time, 0.52 + 0 * time])], axis=1)
    base = replace(trace_edges(("a", "b"), walk), interaction=Interaction(8))
    wishes = pair_edges(base, [("a", "b")], 0.1, kind=INTERACTION)
    graph = base.joined(wishes)
    numeric = gradient(graph, walk)
    assert np.abs(numeric[:5]).max() == 0.0
    assert np.abs(numeric[8:14]).max() > 0.1
    solution = solve(graph, walk, Ipopt([INTERACTION]))
    assert distances(wishes, solution.positions).min() > 0.09


def test_bad_options_are_refused() -> None:
    with pytest.raises(UsageError, match="memory must be in"):
        Spectral(memory=1.5)
