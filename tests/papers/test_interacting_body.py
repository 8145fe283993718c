"""A whole body whose pairs are measured by the interaction distance: the dynDGP that the 2019 paper leaves to future work."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform

from robot_retarget.base.errors import UsageError
from robot_retarget.papers import Blend, Interaction, Ipopt, Spectral, adapt, solve, stress
from robot_retarget.papers.skeletal import ARMS, resized, table_one_body

AHEAD = Interaction(6, dead_band=1e-4)


def clapping(frames: int = 24) -> np.ndarray:
    """The body of Table I; its forearms swing towards each other and apart, the rest stands. (T, 22, 3) [m]."""
    body = table_one_body()
    x = np.tile(body.initial_pose, (frames, 1, 1))
    swing = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frames) / 12)
    for side, sign in (("R", 1.0), ("L", -1.0)):
        elbow, wrist = (body.names.index(side + joint) for joint in ("E", "W"))
        way = np.stack([np.full(frames, 0.8), sign * (0.8 * swing), np.full(frames, 0.2)], axis=1)
        x[:, wrist] = x[:, elbow] + 0.258 * way / np.linalg.norm(way, axis=1, keepdims=True)
    return x


def test_the_own_body_and_a_uniformly_larger_one_are_exact() -> None:
    body, x = table_one_body(), clapping()
    for factor in (1.0, 1.3):
        larger = Interaction(6, dead_band=1e-4 * factor)
        graph = adapt(x, body, body.scaled(factor), interaction=AHEAD)
        assert graph.interaction == AHEAD and (graph.edges.kind == "interaction").sum() == 23 * (231 - 21)
        assert stress(adapt(x, body, body, interaction=larger), x) < 1e-20
        assert stress(graph, factor * x) == pytest.approx(0.0, abs=1e-12)


def test_no_interaction_distance_is_over_the_euclidean_one() -> None:
    body, x = table_one_body(), clapping()
    far, near = adapt(x, body, body), adapt(x, body, body, interaction=AHEAD)
    assert (near.edges.lower <= far.edges.lower + 1e-12).all() and (near.edges.lower < far.edges.lower - 0.01).any()
    frame, a = np.divmod(far.edges.i, 22)
    table = np.stack([squareform(pdist(each)) for each in x])
    np.testing.assert_allclose(far.edges.lower, table[frame, a, far.edges.j % 22], rtol=1e-12)


def test_longer_arms_are_solved_from_the_euclidean_solution_and_not_from_the_source() -> None:
    body, x = table_one_body(), clapping()
    longer = resized(body, dict.fromkeys(ARMS, 1.2))
    moving = adapt(x, body, longer, interaction=AHEAD)
    euclid = solve(adapt(x, body, longer), x, Ipopt(())).positions
    options = Spectral(max_iterations=400)
    near, far = (solve(moving, start, options).stress for start in (euclid, x))
    assert near < 0.9 * stress(moving, euclid) and near < 0.7 * far


def test_a_blend_of_two_measures_is_refused() -> None:
    body = table_one_body()
    with pytest.raises(UsageError, match="give a blend or an interaction"):
        adapt(clapping(), body, body, Blend(), AHEAD)
