"""The papers' future work: D in place of the Euclidean distance, and formations that stay rigid."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from paper_instances import smoothness_edges
from paper_scenes import meeting, team

from robot_retarget.base.errors import UsageError
from robot_retarget.papers import (
    Interaction,
    Ipopt,
    Objective,
    Sensing,
    Team,
    distances,
    formation_rigidity,
    pair_edges,
    solve,
    solve_causally,
    solve_formation,
    solve_with_thresholds,
    stress,
)
from robot_retarget.papers.edges import INTERACTION
from robot_retarget.papers.solvers import PointSolution


def walked_online(horizon: int) -> PointSolution:
    """Two objects that meet, solved frame by frame; horizon 0 is the Euclidean distance."""
    scene = meeting()
    base = replace(scene.traces(False), interaction=Interaction(horizon))
    wishes = pair_edges(base, [("a", "b")], 0.1, kind=INTERACTION, priority=100.0)
    graph = base.joined(wishes, smoothness_edges(scene.names, scene.animation))
    return solve_causally(graph, scene.animation, Ipopt(()), Objective.HALF_SQUARED)


def first_reaction(x: np.ndarray) -> int:
    return int(np.argmax(np.abs(x[:, 0, 1] - meeting().animation[:, 0, 1]) > 0.002))


def test_interaction_distance_avoids_earlier_and_more_gently() -> None:
    found = {horizon: walked_online(horizon).positions for horizon in (0, 5, 10, 20)}
    reaction = {horizon: first_reaction(x) for horizon, x in found.items()}
    force = {horizon: np.linalg.norm(np.diff(x, 2, axis=0), axis=-1).max() for horizon, x in found.items()}
    assert reaction[0] - reaction[5] >= 4
    assert reaction[5] - reaction[10] >= 4
    assert reaction[10] - reaction[20] >= 8
    assert force[5] < force[0] / 4
    assert force[20] < force[0] / 10
    for x in found.values():
        assert np.linalg.norm(x[:, 0] - x[:, 1], axis=1).min() > 0.1 - 1e-3


def test_causal_solution_does_not_know_the_future() -> None:
    scene = meeting()
    graph = scene.traces(False).joined(scene.thresholds(0.1))
    whole = solve_causally(graph, scene.animation, Ipopt(()))
    spoilt = scene.animation.copy()
    spoilt[4:] += 7.0
    np.testing.assert_array_equal(solve_causally(graph, spoilt, Ipopt(())).positions[:, :2], whole.positions[:, :2])
    np.testing.assert_array_equal(whole.positions[:3], scene.animation[:3])


def test_window_longer_than_the_animation_is_refused() -> None:
    scene = meeting(5)
    with pytest.raises(UsageError, match="window must be 2 … 5 frames, got 6"):
        solve_causally(scene.traces(False), scene.animation, window=6)


def test_smoothness_edges_measure_the_second_difference() -> None:
    rng = np.random.default_rng(3)
    source, x = rng.normal(size=(2, 6, 2, 3))
    graph = smoothness_edges(("a", "b"), source)
    expected = np.linalg.norm(np.diff(x, 2, axis=0), axis=-1).ravel()
    np.testing.assert_allclose(distances(graph, x), expected, rtol=1e-13)
    assert stress(graph, source) == 0.0


def formation() -> Team:
    return Team(np.arange(6), np.array([6]), Sensing(0.22, 0.34, 0.08, 0.03), least=0.005)


def test_gradient_of_the_formation_meets_finite_differences() -> None:
    from robot_retarget.papers.formation import _rigidity

    x = team().animation[15:20] + 0.02 * np.random.default_rng(0).normal(size=(5, 7, 2))
    exact, step = _rigidity(formation(), x)[1], 1e-6
    for vertex in range(6):
        for axis in range(2):
            move = np.zeros_like(x)
            move[:, vertex, axis] = step
            numeric = (formation_rigidity(formation(), x + move) - formation_rigidity(formation(), x - move)) / (
                2 * step
            )
            np.testing.assert_allclose(exact[:, vertex, axis], numeric, atol=1e-8)


def test_formation_stays_rigid_past_the_obstacle_only_with_the_constraint() -> None:
    scene = team()
    base, candidates = scene.traces(True), scene.thresholds(0.15)
    split = solve_with_thresholds(base, candidates, scene.animation, partial(solve, objective=Objective.HALF_SQUARED))
    assert formation_rigidity(formation(), scene.animation)[[0, -1]].min() > 0.01
    assert formation_rigidity(formation(), split.positions).min() < 1e-4
    rigid = solve_formation(base.joined(candidates), split.positions, formation())
    assert formation_rigidity(formation(), rigid.positions).min() > 0.004
    for solution in (split, rigid):
        assert distances(candidates, solution.positions).min() > 0.15 - 1e-3
        np.testing.assert_array_equal(solution.positions[[0, -1]], scene.animation[[0, -1]])
