"""Branch and prune: all realizations, exact edges."""

import numpy as np
import pytest
from paper_instances import lifted_starts, nearest_realization, random_starts, sensor_network, stiff_mesh
from scipy.spatial.distance import pdist
from small_graphs import graph_of

from robot_retarget.base.errors import GraphError
from robot_retarget.papers import Ipopt, Spectral, adapt, distances, frame_edges, multistart, solve
from robot_retarget.papers.branch import (
    Branching,
    branch_and_prune,
    discretization_order,
    intersect,
)
from robot_retarget.papers.evaluation import relative_errors
from robot_retarget.papers.skeletal import realize, resized, table_one_body

RNG = np.random.default_rng(13)


def named(count: int) -> tuple[str, ...]:
    return tuple(f"v{vertex}" for vertex in range(count))


def mirrors(positions: np.ndarray) -> int:
    """Pairs of realizations that mirror each other in the plane of the first clique."""
    turned = positions * np.append(np.ones(positions.shape[2] - 1), -1.0)
    apart = np.abs(positions[:, None] - turned[None]).max(axis=(2, 3))
    return int(np.triu(apart < 1e-6 * np.abs(positions).max(), 1).sum())


@pytest.mark.parametrize("dimension", [2, 3])
def test_spheres_meet_where_their_distances_say(dimension: int) -> None:
    point, centres = RNG.normal(size=(200, dimension)), RNG.normal(size=(200, dimension, dimension))
    radii = np.linalg.norm(centres - point[:, None], axis=-1)
    found = intersect(centres, radii)
    reached = np.linalg.norm(found[:, :, None] - centres, axis=-1)
    np.testing.assert_allclose(reached, np.broadcast_to(radii, reached.shape), rtol=1e-6)
    assert (np.abs(found - point).max(axis=-1).min(axis=0) < 1e-6).all()


def test_spheres_that_do_not_meet_are_nan() -> None:
    assert np.isnan(intersect(np.array([[0.0, 0], [3, 0]]), np.array([1.0, 1.0]))).all()
    assert np.isnan(intersect(np.array([[0.0, 0], [0, 0]]), np.array([1.0, 1.0]))).all()
    touching = intersect(np.array([[0.0, 0], [2, 0]]), np.array([1.0, 1.0]))
    np.testing.assert_allclose(touching, [[1, 0], [1, 0]], atol=1e-9)


def test_complete_posture_has_two_mirrored_realizations() -> None:
    body = table_one_body()
    posture = realize(body, RNG.uniform(-0.5, 0.5, (1, 22, 3)), np.zeros((1, 3)))[0]
    graph = frame_edges(body.names, posture)
    found = branch_and_prune(graph)
    assert found.complete
    assert len(found.positions) == 2
    first, second = found.positions
    for x in (first, second):
        np.testing.assert_allclose(pdist(x), pdist(posture), atol=1e-9)
        assert relative_errors(graph, x).max() < 1e-12
    np.testing.assert_allclose(first * [1, 1, -1], second, atol=1e-12)
    assert mirrors(found.positions) == 1


@pytest.mark.parametrize("count", [6, 8, 10, 12])
def test_chain_has_a_realization_per_branch(count: int) -> None:
    graph = frame_edges(named(count), RNG.normal(size=(count, 3)))
    found = branch_and_prune(graph.select(np.abs(graph.edges.i - graph.edges.j) <= 3))
    assert len(found.positions) == 2 ** (count - 3)
    assert mirrors(found.positions) == 2 ** (count - 4)
    assert (
        max(relative_errors(graph.select(np.abs(graph.edges.i - graph.edges.j) <= 3), x).max() for x in found.positions)
        < 1e-9
    )


def test_chain_in_the_plane_has_a_realization_per_branch() -> None:
    graph = frame_edges(named(7), RNG.normal(size=(7, 2)))
    assert len(branch_and_prune(graph.select(np.abs(graph.edges.i - graph.edges.j) <= 2)).positions) == 2**5


def test_two_tetrahedra_have_two_shapes_and_their_mirrors() -> None:
    x = RNG.normal(size=(5, 3))
    graph = frame_edges(named(5), x)
    found = branch_and_prune(graph.select(~((graph.edges.i == 3) & (graph.edges.j == 4)))).positions
    apart = np.linalg.norm(found[:, 3] - found[:, 4], axis=1)
    assert len(found) == 4
    assert len(np.unique(apart.round(9))) == 2
    assert np.isclose(apart, np.linalg.norm(x[3] - x[4])).sum() == 2


def test_interval_reference_is_sampled_and_pruned() -> None:
    x = RNG.normal(size=(6, 3))
    graph = frame_edges(named(6), x)
    wide = (graph.edges.i == 0) & (graph.edges.j == 3)
    thin = (graph.edges.i == 0) & (graph.edges.j == 5)
    graph = graph.with_targets(
        lower=np.where(wide, 0.9 * graph.edges.lower, graph.edges.lower), upper=graph.edges.lower * (1 + 0.1 * wide)
    )
    graph = graph.select(~thin)
    found = branch_and_prune(graph, Branching(tolerance=0.05, samples=41))
    assert len(found.positions) >= 2
    polished = [solve(graph, y, Ipopt(())) for y in found.positions]
    assert min(solution.largest_error for solution in polished) < 1e-8
    middle = graph.edges.exact
    assert all(np.abs(distances(graph, y) - graph.edges.lower)[middle].max() < 0.05 for y in found.positions)


def test_search_stops_at_its_limits() -> None:
    graph = frame_edges(named(12), RNG.normal(size=(12, 3)))
    graph = graph.select(np.abs(graph.edges.i - graph.edges.j) <= 3)
    found = branch_and_prune(graph, Branching(solutions=5))
    assert (len(found.positions), found.complete) == (5, False)


def test_contradicting_distances_have_no_realization() -> None:
    graph = frame_edges(named(6), RNG.normal(size=(6, 3)))
    lower = graph.edges.lower.copy()
    lower[-1] *= 1.01
    found = branch_and_prune(graph.with_targets(lower=lower, upper=lower))
    assert (len(found.positions), found.complete) == (0, True)
    with pytest.raises(GraphError, match="no realization meets the distances"):
        nearest_realization(found, np.zeros((6, 3)))


def test_graph_that_cannot_be_discretized_names_the_vertex() -> None:
    with pytest.raises(GraphError, match=r"vertex 'd' has 1 references \(1 exact\) where 2 are needed"):
        discretization_order(graph_of("abcd", "ab bc ac cd", 1.0))
    with pytest.raises(GraphError, match="no 2 vertices are joined pairwise by exact edges"):
        discretization_order(graph_of("abc", "ab bc ac", 1.0, 2.0))
    with pytest.raises(GraphError, match="the graph has 2: use at_frame"):
        branch_and_prune(frame_edges(named(4), RNG.normal(size=(2, 4, 3))))


def test_mesh_does_not_vibrate_under_branch_and_prune() -> None:
    exact, soft = [], []
    previous = np.zeros((6, 3))
    for frame in range(8):
        interval, pulled = stiff_mesh(frame)
        found = branch_and_prune(interval, Branching(tolerance=2e-3, samples=41))
        start = nearest_realization(found, previous) if frame else found.positions[0]
        mesh = interval.select(interval.edges.exact)
        assert len(mesh.edges) == 12
        previous = solve(mesh, start, Ipopt(())).positions[0]
        exact.append(distances(mesh, previous))
        soft.append(distances(mesh, solve(pulled, previous).positions))
    assert np.std(exact, axis=0).max() < 1e-8
    assert np.std(soft, axis=0).max() > 1e-4


def test_exact_mesh_has_exact_edges_in_every_realization() -> None:
    interval, _ = stiff_mesh(0)
    true = stiff_mesh(0, 0.0)[1].edges.lower
    exact = interval.with_targets(lower=true, upper=true)
    found = branch_and_prune(exact)
    assert len(found.positions) == 2
    assert mirrors(found.positions) == 1
    assert max(np.abs(distances(exact, x) - exact.edges.lower).max() for x in found.positions) < 1e-12


@pytest.mark.parametrize(("count", "seed"), [(44, 2)])
def test_sparse_sensor_networks_are_solved_from_lifted_starts(count: int, seed: int) -> None:
    graph = sensor_network(count, seed)
    assert len(graph.edges) < 4 * count
    rough = multistart(graph, list(lifted_starts(graph, 12, seed)))
    assert solve(graph, rough.positions, Ipopt(())).largest_error < 1e-3


def test_random_starts_give_either_handedness() -> None:
    body = table_one_body()
    graph = adapt(body.initial_pose, body, resized(body, {"RE": 1.2, "RW": 1.2, "LE": 1.2, "LW": 1.2}))
    hips, left, right, chest, knee = (body.names.index(name) for name in ("H", "LH", "RH", "CB", "LK"))

    def handed(x: np.ndarray) -> bool:
        return bool(np.linalg.det([x[left] - x[right], x[chest] - x[hips], x[knee] - x[hips]]) > 0)

    found = [solve(graph, start) for start in random_starts(graph, 24)]
    assert max(solution.stress for solution in found) == pytest.approx(1.58203459e-2, rel=1e-4)
    same = sum(handed(solution.positions[0]) == handed(body.initial_pose) for solution in found)
    assert 4 <= same <= 20


def test_random_starts_solve_a_complete_posture() -> None:
    body = table_one_body()
    graph = frame_edges(body.names, body.initial_pose)
    found = multistart(graph, list(random_starts(graph, 5)), Spectral(value_tolerance=1e-16, step_tolerance=1e-10))
    np.testing.assert_allclose(pdist(found.positions[0]), pdist(body.initial_pose), atol=1e-6)
