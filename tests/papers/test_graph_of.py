"""The graph of a motion: its edges are the motion's distances; Huber scales count large errors linearly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_graphs import with_huber

from robot_retarget.base.errors import GraphError
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.read import read_motion
from robot_retarget.papers import (
    Ipopt,
    Objective,
    SkeletalStructure,
    distances,
    frame_edges,
    solve,
    solve_frames,
    stress,
)
from robot_retarget.papers.build import motion_graph
from robot_retarget.papers.evaluation import gradient


def test_a_motion_is_the_realization_without_stress_of_its_own_graph() -> None:
    motion = read_motion(SAMPLES / "wave.bvh").frames(0, 12)
    graph, joints = motion_graph(motion), len(motion.skeleton)
    assert graph.vertices == motion.skeleton.names and graph.frames == 12
    assert stress(graph, motion.positions) == 0.0
    assert (graph.edges.kind == "bone").sum() == 12 * (joints - 1)
    assert ((graph.edges.kind == "bone") | (graph.edges.kind == "posture")).sum() == 12 * joints * (joints - 1) // 2
    assert (
        np.char.startswith(graph.edges.kind, "trace").sum() == joints * 3 * (2 * 12 - 3 - 1) // 2
    )  # τ (2n − τ − 1)/2 an object
    bones = graph.select(graph.edges.kind == "bone")
    body = SkeletalStructure.of(motion)
    np.testing.assert_allclose(np.sort(bones.edges.lower[: joints - 1]), np.sort(body.lengths[1:]), rtol=1e-9)
    assert motion_graph(motion, traces=0, postures=False).edges.kind.tolist() == ["bone"] * 12 * (joints - 1)


def test_places_without_a_tree_are_numbered_and_obstacles_stay() -> None:
    x = np.random.default_rng(0).normal(size=(5, 3, 2))
    graph = motion_graph(x, postures=False, traces=2, fixed=["2"])
    assert graph.vertices == ("0", "1", "2") and set(graph.edges.kind.tolist()) == {"trace 1", "trace 2"}
    assert graph.fixed.tolist() == [[False, False, True]] * 5
    assert motion_graph(x, ["a", "b", "c"]).vertices == ("a", "b", "c")
    assert len(motion_graph(x[:1]).edges) == 3
    with pytest.raises(GraphError, match=r"unknown vertex 'rock'.*0, 1, 2"):
        motion_graph(x, fixed=["rock"])
    with pytest.raises(GraphError, match="an animation is"):
        motion_graph(x[0, 0])


@given(st.integers(0, 2**32 - 1), st.sampled_from([Objective.SQUARED, Objective.HALF_SQUARED]))
def test_huber_scales_count_small_errors_by_squares_and_large_ones_linearly(seed: int, objective: Objective) -> None:
    draw = np.random.default_rng(seed)
    x, y = draw.normal(size=(2, 5, 3))
    g = draw.uniform(0.05, 2.0)
    graph = with_huber(frame_edges("abcde", x, draw.uniform(0.01, 3.0, 10)), g)
    error = distances(graph, y) - graph.edges.lower
    loss = graph.edges.priority * 2 * g**2 * (np.sqrt(1 + (error / g) ** 2) - 1)
    half = 0.5 if objective is Objective.HALF_SQUARED else 1.0
    assert stress(graph, y, objective) == pytest.approx(half * loss.sum(), rel=1e-10)
    wide = with_huber(graph, 1e9)
    assert stress(wide, y, objective) == pytest.approx(stress(with_huber(graph, np.inf), y, objective), rel=1e-9)
    step, move = 1e-6, draw.normal(size=(5, 3))
    slope = (stress(graph, y + step * move, objective) - stress(graph, y - step * move, objective)) / (2 * step)
    assert (gradient(graph, y, objective)[0] * move).sum() == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_both_solvers_agree_on_edges_with_huber_scales() -> None:
    draw = np.random.default_rng(1)
    x = draw.normal(size=(2, 5, 3))
    graph = with_huber(frame_edges("abcde", x), 0.1)
    target = graph.edges.lower * draw.uniform(0.5, 1.0, len(graph.edges))
    graph = graph.with_targets(lower=target, upper=target)
    second, spectral = solve(graph, x, Ipopt(())), solve_frames(graph, x)
    assert second.converged and 0.0 < second.stress < 0.3 * stress(graph, x)
    assert spectral.stress == pytest.approx(second.stress, rel=1e-3)
    assert second.iterations[0] < 40


def test_a_huber_scale_of_nothing_is_refused_by_name() -> None:
    with pytest.raises(GraphError, match="posture has the Huber scale 0, which is not above 0"):
        with_huber(frame_edges("abc", np.eye(3)), 0.0)
