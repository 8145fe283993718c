"""The interaction distance against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interacting_positions import feasible_balls, interacting_positions
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.graph.interaction import pair_interaction
from robot_retarget.papers import Interaction, interaction_distance

RNG = np.random.default_rng(11)


def literal(u0: np.ndarray, u1: np.ndarray, v0: np.ndarray, v1: np.ndarray, farthest: int) -> tuple[float, int]:
    """Definition 12 case by case (with the misprints mended and the mirror case added), α = 1 … farthest."""
    alpha = np.arange(1, farthest + 1)[:, None]
    ahead_u, ahead_v = u0 + alpha * (u1 - u0), v0 + alpha * (v1 - v0)
    rest_u, rest_v = (u0 == u1).all(), (v0 == v1).all()
    if rest_u and rest_v:
        return float(np.linalg.norm(v1 - u1)), 1
    if rest_u:
        ahead_u = u1
    if rest_v:
        ahead_v = v1
    apart = np.linalg.norm(ahead_v - ahead_u, axis=1)
    best = int(apart.argmin())
    return float(apart[best]), best + 1


def random_pairs(count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 2, 3) before and after: moving and steady joints, slow and fast, approaching and parting."""
    before = RNG.normal(size=(count, 2, 3))
    step = RNG.normal(size=(count, 2, 3)) * 10.0 ** RNG.uniform(-2, 0, (count, 1, 1))
    step[RNG.random((count, 2)) < 0.25] = 0.0
    return before, before + step


def test_closed_form_is_the_definition() -> None:
    before, now = random_pairs(10_000)
    distance, alpha = interaction_distance(before, now)
    expected = [literal(b[0], n[0], b[1], n[1], 2000) for b, n in zip(before, now, strict=True)]
    assert np.abs(distance[:, 0] - [d for d, _ in expected]).max() < 1e-10
    np.testing.assert_array_equal(alpha[:, 0], [a for _, a in expected])
    assert (alpha > 1).sum() > 2000


def test_pairs_follow_triu_indices_over_any_leading_axes() -> None:
    before, now = RNG.normal(size=(2, 2, 300, 5, 3))
    distance, alpha = interaction_distance(before, now)
    assert distance.shape == alpha.shape == (2, 300, 10)
    u, v = np.triu_indices(5, 1)
    step = now - before
    expected, steps = pair_interaction(now[..., v, :] - now[..., u, :], step[..., v, :] - step[..., u, :])
    np.testing.assert_allclose(distance, expected, atol=1e-13)
    np.testing.assert_array_equal(alpha, steps)


def test_few_frames_and_many_agree() -> None:
    before, now = RNG.normal(size=(2, 40, 6, 3))
    many = interaction_distance(before, now)
    for frame in range(40):
        one = interaction_distance(before[frame], now[frame])
        np.testing.assert_allclose(one[0], many[0][frame], rtol=1e-12)
        np.testing.assert_array_equal(one[1], many[1][frame])


def test_one_joint_has_no_pairs() -> None:
    distance, alpha = interaction_distance(np.zeros((4, 1, 3)), np.ones((4, 1, 3)))
    assert distance.shape == alpha.shape == (4, 0)


def test_interaction_never_exceeds_the_euclidean_distance() -> None:
    before, now = random_pairs(10_000)
    distance, alpha = interaction_distance(before, now)
    euclid = np.linalg.norm(now[:, 1] - now[:, 0], axis=1)
    assert (distance[:, 0] <= euclid * (1 + 1e-15)).all()
    assert (distance >= 0).all()
    assert (alpha >= 1).all()


def test_symmetry_is_exact() -> None:
    before, now = random_pairs(10_000)
    forth, back = interaction_distance(before, now), interaction_distance(before[:, ::-1], now[:, ::-1])
    np.testing.assert_array_equal(forth[0], back[0])
    np.testing.assert_array_equal(forth[1], back[1])


def test_a_joint_and_itself_are_at_zero() -> None:
    distance, alpha = interaction_distance([[1, 2, 3], [1, 2, 3]], [[2, 2, 4], [2, 2, 4]])
    assert (distance[0], alpha[0]) == (0.0, 1)


def test_distinct_joints_may_be_at_zero() -> None:
    distance, alpha = interaction_distance([[-2, 0, 0], [0, -2, 0]], [[-1.5, 0, 0], [0, -1.5, 0]])
    assert (distance[0], alpha[0]) == (0.0, 4)


def test_triangle_inequality_fails() -> None:
    before, now = np.array([[[0, 0, 0], [1, 0, 0], [-2, 0, 0]], [[0, 0, 0], [1, 0, 0], [-1.5, 0, 0]]])
    distance, alpha = interaction_distance(before, now)
    assert distance.tolist() == [1.0, 0.0, 0.0]
    assert alpha.tolist() == [1, 4, 6]


def test_ties_take_the_earlier_instant() -> None:
    distance, alpha = interaction_distance([[0.0], [3.5]], [[0.0], [2.5]])
    assert (distance[0], alpha[0]) == (0.5, 3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), scale=st.floats(0.1, 10))
def test_common_steps_and_rigid_motions_change_nothing_and_scale_scales(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    before, now = rng.normal(size=(2, 4, 3))
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    shift, drift = rng.normal(size=(2, 3))
    plain, _ = interaction_distance(before, now)
    moved, _ = interaction_distance(before @ turn + shift, now @ turn + shift + drift)
    np.testing.assert_allclose(moved, plain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        interaction_distance(scale * before, scale * now)[0], scale * plain, rtol=1e-9, atol=1e-12
    )


def test_comoving_joints_are_euclidean_despite_rounding() -> None:
    before = RNG.normal(size=(5000, 2, 3))
    now = before + RNG.normal(size=(5000, 1, 3))
    noisy = (now[:, 1] - before[:, 1]) - (now[:, 0] - before[:, 0])
    assert (noisy != 0).any(axis=1).mean() > 0.5
    distance, alpha = interaction_distance(before, now)
    np.testing.assert_allclose(distance[:, 0], np.linalg.norm(now[:, 1] - now[:, 0], axis=1), rtol=1e-12)
    assert (alpha == 1).all()


def test_without_dead_band_rounding_turns_comoving_joints_into_contacts() -> None:
    before = RNG.normal(size=(5000, 2, 3))
    now = before + RNG.normal(size=(5000, 1, 3))
    distance, _ = interaction_distance(before, now, dead_band=0.0)
    assert np.abs(distance[:, 0] - np.linalg.norm(now[:, 1] - now[:, 0], axis=1)).max() > 0.1


def test_jitter_is_bounded_by_horizon_or_dead_band() -> None:
    rest = np.tile([[0.0, 0, 0], [1.0, 0, 0]], (4000, 1, 1))
    jitter = rest + 1e-4 * RNG.normal(size=rest.shape)
    after = rest + 1e-4 * RNG.normal(size=rest.shape)
    assert interaction_distance(jitter, after)[0].min() < 0.5
    assert interaction_distance(jitter, after, horizon=30)[0].min() > 0.95
    assert interaction_distance(jitter, after, dead_band=2e-3)[0].min() > 0.99


def test_horizon_loses_at_most_its_steps() -> None:
    before, now = random_pairs(3000)
    distance, alpha = interaction_distance(before, now, horizon=7)
    expected = [literal(b[0], n[0], b[1], n[1], 8)[0] for b, n in zip(before, now, strict=True)]
    np.testing.assert_allclose(distance[:, 0], expected, atol=1e-10)
    assert alpha.max() == 8
    assert interaction_distance(before, now, horizon=0)[1].max() == 1


def test_continuous_relaxation_is_within_half_a_step() -> None:
    before, now = random_pairs(5000)
    step = now - before
    c, w = now[:, 1] - now[:, 0], step[:, 1] - step[:, 0]
    gap = pair_interaction(c, w)[0] - pair_interaction(c, w, Interaction(continuous=True))[0]
    assert (gap >= -1e-12).all()
    assert (gap <= np.linalg.norm(w, axis=1) / 2 + 1e-12).all()
    assert gap.max() > 0.01


def test_feasible_balls_are_where_the_distance_is_smaller() -> None:
    inside = 0
    for _ in range(2000):
        u0, u1, v0, v1 = RNG.normal(size=(4, 2)) * [[1], [0.5], [1], [1]]
        wanted = RNG.uniform(0.05, 1.0)
        centres, radii = feasible_balls(u0, u1, v0, wanted, 200)
        distance, _ = interaction_distance([u0, v0], [u1, v1], horizon=200)
        within = bool((np.linalg.norm(v1 - centres, axis=1) < radii).any())
        assert within == (distance[0] < wanted)
        inside += within
    assert 100 < inside < 1900


def test_feasible_balls_shrink_towards_the_common_step() -> None:
    centres, radii = feasible_balls([0, 0], [0.5, 0], [2, 1], 0.3, 1000)
    apex = np.array([2.5, 1.0])
    reach = np.linalg.norm(centres - apex, axis=1)
    np.testing.assert_allclose(reach / radii, reach[0] / radii[0], rtol=1e-9)
    assert radii[-1] < 1e-3


def test_two_constraints_are_solved_over_all_pairs_of_alpha() -> None:
    recovered = recovered_equal = usable = 0
    for _ in range(120):
        before, now = RNG.normal(size=(2, 2, 2))
        now = before + 0.3 * now
        v0 = RNG.normal(size=2)
        v1 = v0 + 0.3 * RNG.normal(size=2)
        distance, alpha = interaction_distance(np.vstack([before, v0]), np.vstack([now, v1]), horizon=20)
        if min(distance[1:]) < 0.05 or alpha[1:].max() == 21:
            continue
        usable += 1
        found, _ = interacting_positions(before, now, v0, distance[1:], horizon=20)
        recovered += bool(len(found)) and np.abs(found - v1).max(axis=1).min() < 1e-6
        same, _ = interacting_positions(before, now, v0, distance[1:], horizon=20, equal=True)
        recovered_equal += bool(len(same)) and np.abs(same - v1).max(axis=1).min() < 1e-6
    assert usable > 60
    assert recovered == usable
    assert 0 < recovered_equal < usable


def test_three_constraints_are_solved_in_space() -> None:
    before = RNG.normal(size=(3, 3))
    now, v0 = before + 0.2 * RNG.normal(size=(3, 3)), RNG.normal(size=3)
    v1 = v0 + 0.2 * RNG.normal(size=3)
    distance, _ = interaction_distance(np.vstack([before, v0]), np.vstack([now, v1]), horizon=8)
    found, alphas = interacting_positions(before, now, v0, distance[[2, 4, 5]], horizon=8)
    assert np.abs(found - v1).max(axis=1).min() < 1e-6
    assert alphas.shape == found.shape


def test_bad_input_is_named() -> None:
    with pytest.raises(GraphError, match="must both be"):
        interaction_distance(np.zeros((3, 3)), np.zeros((4, 3)))
    lost = np.zeros((3, 4, 3))
    lost[1, 2, 0] = np.nan
    with pytest.raises(GraphError, match=r"current is not finite at joint 2, index \(1, 2, 0\)"):
        interaction_distance(np.zeros((3, 4, 3)), lost)
    with pytest.raises(UsageError, match="horizon must be None or ≥ 0 steps, got -1"):
        interaction_distance(np.zeros((3, 3)), np.zeros((3, 3)), horizon=-1)
    with pytest.raises(UsageError, match="dead_band must be ≥ 0 m"):
        interaction_distance(np.zeros((3, 3)), np.zeros((3, 3)), dead_band=np.nan)
    with pytest.raises(GraphError, match="2 constraints are needed in dimension 2"):
        interacting_positions(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(2), np.ones(3))
