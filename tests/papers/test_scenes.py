"""The animations of the 2019 paper: thresholds hold in every frame, anchored frames stay."""

from functools import partial

import numpy as np
import pytest
from paper_scenes import (
    Crowd,
    clock,
    crossing,
    figure,
    meeting,
    pedestrians,
    raised_hands,
    reaching,
    shortened_arms,
    together,
)

from robot_retarget.papers import (
    Ipopt,
    Objective,
    bone_edges,
    distances,
    frame_edges,
    interaction_distance,
    solve,
    solve_with_thresholds,
)
from robot_retarget.papers.solvers import PointSolution

papers = partial(solve, objective=Objective.HALF_SQUARED)
SCENES = {"meeting": meeting, "crossing": crossing, "clock": clock}

# ½ Σ π e² at the minimum with the first and last frame held and thresholds hard in every frame.
ANCHORED = {
    ("meeting", 0.1): 2.371e-6,
    ("meeting", 0.2): 6.551e-5,
    ("crossing", 0.1): 1.789e-5,
    ("crossing", 0.2): 3.314e-4,
}


def closest(scene: Crowd, threshold: float, x: np.ndarray) -> float:
    return float(distances(scene.thresholds(threshold), x).min())


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("threshold", [0.1, 0.2])
def test_thresholds_hold_in_every_frame(name: str, threshold: float) -> None:
    scene = SCENES[name]()
    assert closest(scene, threshold, scene.animation) < 0.05
    free = solve_with_thresholds(scene.traces(False), scene.thresholds(threshold), scene.animation, papers)
    assert closest(scene, threshold, free.positions) >= threshold - 1e-4


@pytest.mark.parametrize("name", list(SCENES))
@pytest.mark.parametrize("threshold", [0.1, 0.2])
def test_anchored_frames_stay_while_hard_thresholds_hold(name: str, threshold: float) -> None:
    scene = SCENES[name]()
    base, candidates = scene.traces(True), scene.thresholds(threshold)
    soft = solve_with_thresholds(base, candidates, scene.animation, papers)
    hard = solve(base.joined(candidates), soft.positions, Ipopt(), Objective.HALF_SQUARED)
    assert hard.converged
    for solution in (soft, hard):
        np.testing.assert_array_equal(solution.positions[[0, -1]], scene.animation[[0, -1]])
    assert closest(scene, threshold, hard.positions) >= threshold - 1e-8
    if (name, threshold) in ANCHORED:
        assert hard.stress == pytest.approx(ANCHORED[name, threshold], rel=2e-3)


def test_thresholds_detected_once_are_lost_on_the_way() -> None:
    scene = clock()
    base, candidates = scene.traces(True), scene.thresholds(0.2)
    once = solve_with_thresholds(base, candidates, scene.animation, papers, rounds=1)
    again = solve_with_thresholds(base, candidates, scene.animation, papers)
    assert closest(scene, 0.2, once.positions) < 0.2 - 1e-3
    assert closest(scene, 0.2, again.positions) >= 0.2 - 1e-4


def sides(solution: PointSolution) -> np.ndarray:
    """How far above the line of the obstacle each pedestrian passes it."""
    track = solution.positions[:, :2]
    frame = np.abs(track[:, :, 0] - 0.5).argmin(axis=0)
    return track[frame, [0, 1], 1] - 0.5


@pytest.mark.parametrize("offset", [0.0, 0.005, 0.02])
def test_friends_split_without_an_edge_and_stay_together_with_it(offset: float) -> None:
    scene = pedestrians(offset=offset)
    base, candidates = scene.traces(False), scene.thresholds(0.1)
    apart = solve_with_thresholds(base, candidates, scene.animation, papers)
    joined = solve_with_thresholds(base.joined(together(scene)), candidates, scene.animation, papers)
    assert np.prod(sides(apart)) < 0 < np.prod(sides(joined))
    gap = np.linalg.norm(joined.positions[:, 0] - joined.positions[:, 1], axis=1)
    np.testing.assert_allclose(gap, 0.06, atol=1e-3)
    assert np.linalg.norm(apart.positions[:, 0] - apart.positions[:, 1], axis=1).max() > 0.19
    for solution in (apart, joined):
        assert closest(scene, 0.1, solution.positions) >= 0.1 - 1e-4


def test_shorter_arms_collide_by_angle_transfer_but_not_by_distances() -> None:
    body = figure()
    target = shortened_arms(body)
    source, transferred = raised_hands(body), raised_hands(target)
    assert closest(source, 0.06, source.animation) == pytest.approx(0.061, abs=5e-4)
    assert closest(source, 0.06, transferred.animation) == pytest.approx(0.014, abs=5e-4)
    candidates = source.thresholds(0.06)
    for traced in (source, transferred):
        base = traced.traces(False)
        base = base.joined(bone_edges(base, target))
        soft = solve_with_thresholds(base, candidates, traced.animation, papers)
        assert closest(source, 0.06, soft.positions) >= 0.06 - 1e-4
        assert soft.relative_errors[soft.graph.edges.kind == "bone"].max() < 1e-3


def test_weak_posture_edges_keep_the_raised_hands_near_the_head_with_exact_bones() -> None:
    target = shortened_arms(figure())
    scene = raised_hands(target, 30)
    traces, candidates = scene.traces(False), scene.thresholds(0.06)
    base = traces.joined(frame_edges(scene.names, scene.animation, 0.01), bone_edges(traces, target))
    hard = solve(base.joined(candidates), scene.animation, Ipopt(), Objective.HALF_SQUARED)
    assert closest(scene, 0.06, hard.positions) == pytest.approx(0.06, abs=1e-7)
    assert np.abs(hard.errors[hard.graph.edges.kind == "bone"]).max() < 1e-9
    assert np.linalg.norm(hard.positions[0] - scene.animation[0], axis=1).max() < 0.005


def test_papers_solution_of_the_raised_hands_changes_early_frames_too() -> None:
    body = figure()
    source, target = raised_hands(body), shortened_arms(body)
    base = source.traces(False)
    found = solve_with_thresholds(
        base.joined(bone_edges(base, target)), source.thresholds(0.06), source.animation, papers
    )
    transferred = raised_hands(target).animation
    assert np.linalg.norm(found.positions[0] - transferred[0], axis=1).max() > 0.01


def test_meeting_can_be_solved_by_a_rigid_shift_without_stress() -> None:
    scene = meeting(20)
    base, candidates = scene.traces(False), scene.thresholds(0.1)
    start = solve_with_thresholds(base, candidates, scene.animation, papers).positions
    exact = solve(base.joined(candidates), start, Ipopt(()), Objective.HALF_SQUARED)
    assert exact.stress < 1e-10
    assert np.abs(exact.positions[[0, -1]] - scene.animation[[0, -1]]).max() > 0.005


def test_interaction_distance_sees_the_wrist_coming_twenty_frames_ahead() -> None:
    x, _ = reaching()
    distance, alpha = interaction_distance(x[:-1], x[1:])
    euclid = np.linalg.norm(x[1:, 0] - x[1:, 1], axis=1)
    late, early = int(np.argmax(euclid < 0.1)), int(np.argmax(distance[:, 0] < 0.1))
    assert late - early >= 15
    assert alpha[early, 0] == pytest.approx(late - early, abs=6)
    assert distance.min() < euclid[-1] - 0.02
    bounded, _ = interaction_distance(x[:-1], x[1:], horizon=10)
    assert 5 <= late - int(np.argmax(bounded[:, 0] < 0.1)) < late - early
