"""Posture adaptation of 2017: its matrices, and the minima every solver must find."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.base.errors import GraphError
from robot_retarget.human.match import normalised_distances, path_priorities, path_weights
from robot_retarget.papers import (
    Blend,
    Ipopt,
    SkeletalStructure,
    Spectral,
    adapt,
    solve,
    solve_frames,
    stress,
    transfer_directions,
)
from robot_retarget.papers.evaluation import errors
from robot_retarget.papers.skeletal import posture_cases, realize, resized, table_one_body

BODY = table_one_body()
POSTURE = BODY.initial_pose

# Stress at the start (the source posture), at the minimum, and at the minimum with hard bones.
ORACLE = {
    "uniform ×1.2": (2.81, 0.0, 0.0),
    "arms +20 %": (0.1358, 1.58203459e-2, 1.69047e-2),
    "arms −40 %": (0.5434, 7.58972582e-2, 1.03287e-1),
    "arms +60 %": (1.223, 1.26072779e-1, 1.34320e-1),
    "upper arms −20 %": (0.0582, 8.25263832e-3, 1.07418e-2),
    "forearms +50 %": (0.1752, 2.03622276e-2, 2.24513e-2),
    "legs +20 %": (0.8893, 1.04482750e-2, 1.14717e-2),
    "legs +60 %": (8.004, 9.67935648e-2, 1.03520e-1),
    "legs −40 %": (3.557, 3.61200368e-2, 4.40437e-2),
    "spine +20 %": (0.2297, 6.13799704e-3, 6.42326e-3),
    "spine +60 %": (2.068, 4.41168878e-2, 4.72244e-2),
    "child-like": (3.312, 7.45431532e-3, 1.11808e-2),
    "right arm +60 %": (0.5760, 2.65322844e-2, 2.97656e-2),
}


def walked(parents: np.ndarray, u: int, v: int) -> list[int]:
    """The vertices of the path between two joints, found by climbing."""
    climbs = []
    for joint in (u, v):
        climb = [joint]
        while parents[climb[-1]] >= 0:
            climb.append(int(parents[climb[-1]]))
        climbs.append(climb)
    meeting = next(joint for joint in climbs[0] if joint in climbs[1])
    return climbs[0][: climbs[0].index(meeting) + 1] + climbs[1][: climbs[1].index(meeting)][::-1]


def test_every_case_has_an_oracle() -> None:
    assert list(posture_cases()) == list(ORACLE)


@pytest.mark.parametrize("case", list(ORACLE))
def test_both_solvers_reach_the_reference_minimum(case: str) -> None:
    at_start, least, hard_least = ORACLE[case]
    graph = adapt(POSTURE, BODY, resized(BODY, posture_cases()[case]))
    assert stress(graph, POSTURE) == pytest.approx(at_start, rel=2e-3)
    papers, second = solve(graph, POSTURE), solve(graph, POSTURE, Ipopt(()))
    assert papers.converged
    assert second.converged
    assert papers.stress == pytest.approx(least, abs=1e-6)
    assert second.stress == pytest.approx(least, rel=1e-7, abs=1e-12)
    tight = solve(graph, POSTURE, Spectral(value_tolerance=1e-14, step_tolerance=1e-8))
    assert tight.stress == pytest.approx(least, rel=1e-7, abs=1e-12)
    hard = solve(graph, POSTURE, Ipopt())
    assert hard.stress == pytest.approx(hard_least, rel=1e-5, abs=1e-12)
    assert np.abs(hard.errors[graph.edges.kind == "bone"]).max() < 1e-12


def test_papers_tolerances_lose_less_than_a_millionth() -> None:
    graph = adapt(POSTURE, BODY, resized(BODY, posture_cases()["spine +60 %"]))
    assert solve(graph, POSTURE).iterations[0] == pytest.approx(65, abs=5)
    assert solve(graph, POSTURE).stress - ORACLE["spine +60 %"][1] < 1e-8


@settings(max_examples=15, deadline=None)
@given(scale=st.floats(0.3, 3.0))
def test_uniform_scale_leaves_no_stress(scale: float) -> None:
    graph = adapt(POSTURE, BODY, BODY.scaled(scale))
    assert stress(graph, scale * POSTURE) < 1e-24
    assert solve(graph, POSTURE, Ipopt(())).stress < 1e-12


def test_the_same_body_keeps_its_posture() -> None:
    graph = adapt(POSTURE, BODY, BODY)
    assert stress(graph, POSTURE) < 1e-28
    np.testing.assert_array_equal(solve(graph, POSTURE).positions[0], POSTURE)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_normalised_distances_are_one_on_bones_and_at_most_one(seed: int) -> None:
    rho = np.random.default_rng(seed).uniform(-2, 2, (1, 22, 3))
    x = realize(BODY, rho, np.zeros((1, 3)))[0]
    matrix = normalised_distances(x, BODY.parents, BODY.lengths)
    np.testing.assert_allclose(matrix[BODY.bones[:, 0], BODY.bones[:, 1]], 1.0, atol=1e-12)
    assert matrix.max() <= 1.0 + 1e-12
    assert (matrix >= 0).all()
    np.testing.assert_array_equal(matrix, matrix.T)


def test_normalised_distance_is_one_on_a_stretched_limb() -> None:
    x = transfer_directions(np.cumsum(np.ones((4, 3)), axis=0), [-1, 0, 1, 2], [0, 1, 2, 3])
    np.testing.assert_allclose(normalised_distances(x, [-1, 0, 1, 2], [0, 1, 2, 3])[0], [0, 1, 1, 1], atol=1e-12)


def test_path_weights_add_the_bones_of_the_path() -> None:
    tau = path_weights(BODY.parents, BODY.lengths)
    for u in range(22):
        for v in range(u):
            path = walked(BODY.parents, u, v)
            bones = [BODY.lengths[a if BODY.parents[a] == b else b] for a, b in pairwise(path)]
            assert tau[u, v] == pytest.approx(sum(bones), abs=1e-12)


def test_priorities_count_the_vertices_of_the_path() -> None:
    priority = path_priorities(BODY.parents)
    longest = max(len(walked(BODY.parents, u, v)) for u in range(22) for v in range(u))
    assert longest == 12
    for u in range(22):
        for v in range(u):
            assert priority[u, v] == pytest.approx((14 - len(walked(BODY.parents, u, v))) / 12)
    assert priority[BODY.bones[:, 0], BODY.bones[:, 1]].tolist() == [1.0] * 21
    assert priority[priority > 0].min() == pytest.approx(1 / 6)


def hand_at_head() -> SkeletalStructure:
    """The body with its right hand raised beside its head."""
    wrist, elbow, shoulder, head = (BODY.names.index(name) for name in ("RW", "RE", "RS", "HD"))
    chi = BODY.displacements.copy()
    chi[elbow] = 0.273 * np.array([0.55, -0.8, 0.1]) / np.linalg.norm([0.55, -0.8, 0.1])
    towards = POSTURE[head] + [0.06, -0.03, 0.0] - POSTURE[shoulder] - chi[elbow]
    chi[wrist] = 0.258 * towards / np.linalg.norm(towards)
    return SkeletalStructure(BODY.names, BODY.parents, chi)


def test_blend_keeps_near_pairs_better_than_angles_and_directions_better_than_distances() -> None:
    source = hand_at_head()
    x, target = source.initial_pose, resized(source, {"RW": 1.3, "LW": 1.3})
    directed = transfer_directions(x, target.parents, target.lengths)
    plain, blended = adapt(x, source, target), adapt(x, source, target, Blend())
    pair = next(edge for edge in range(len(plain.edges)) if plain.edges.name(edge) in ("HD–RW", "RW–HD"))
    found = {
        "angles": directed,
        "distances": solve(plain, x, Ipopt()).positions,
        "blend": solve(blended, x, Ipopt()).positions,
    }
    miss = {name: abs(float(errors(plain, pose)[pair])) for name, pose in found.items()}
    assert miss["blend"] < 0.5 * miss["angles"]

    def turned(pose: np.ndarray) -> float:
        bones = [y.reshape(22, 3)[1:] - y.reshape(22, 3)[BODY.parents[1:]] for y in (pose, directed)]
        unit = [bone / np.linalg.norm(bone, axis=1, keepdims=True) for bone in bones]
        return float(np.degrees(np.arccos(np.clip((unit[0] * unit[1]).sum(1), -1, 1))).mean())

    assert turned(found["blend"]) < 0.7 * turned(found["distances"])


def test_warm_start_takes_fewer_iterations() -> None:
    graph = adapt(POSTURE, BODY, resized(BODY, posture_cases()["legs +60 %"]))
    nearby = adapt(POSTURE, BODY, resized(BODY, dict.fromkeys(("RK", "RA", "LK", "LA"), 1.58)))
    cold = solve(graph, POSTURE)
    assert solve(graph, solve(nearby, POSTURE).positions).iterations[0] < cold.iterations[0]


def test_postures_solved_side_by_side_equal_postures_solved_alone() -> None:
    rng = np.random.default_rng(3)
    postures = realize(BODY, rng.uniform(-0.4, 0.4, (7, 22, 3)), np.zeros((7, 3)))
    graph = adapt(postures, BODY, resized(BODY, posture_cases()["arms +20 %"]))
    together = solve_frames(graph, postures)
    assert len(together.statuses) == len(together.iterations) == 7
    for frame in range(7):
        alone = solve(graph.at_frame(frame), postures[frame])
        np.testing.assert_allclose(together.positions[frame], alone.positions[0], atol=1e-9)
        assert together.iterations[frame] == alone.iterations[0]


def test_euler_angles_play_on_another_body() -> None:
    rho = np.random.default_rng(5).uniform(-1, 1, (3, 22, 3))
    root = np.zeros((3, 3))
    source, target = realize(BODY, rho, root), realize(BODY.scaled(np.linspace(0.5, 2, 22)), rho, root)
    expected = transfer_directions(source, BODY.parents, BODY.lengths * np.linspace(0.5, 2, 22))
    np.testing.assert_allclose(target, expected, atol=1e-12)


def test_bodies_of_different_trees_are_refused() -> None:
    other = SkeletalStructure(("X", *BODY.names[1:]), BODY.parents, BODY.displacements)
    with pytest.raises(GraphError, match="differ in H; target known: X, C, CA"):
        adapt(POSTURE, BODY, other)


def test_bone_without_direction_is_named() -> None:
    with pytest.raises(GraphError, match="joint 1 coincides with its parent 0"):
        transfer_directions(np.zeros((2, 3)), [-1, 0], [0, 1])


def test_angles_of_another_size_are_refused() -> None:
    with pytest.raises(GraphError, match=r"ρ must be \(T, 22, 3\), got \(1, 5, 3\)"):
        realize(BODY, np.zeros((1, 5, 3)), np.zeros((1, 3)))
