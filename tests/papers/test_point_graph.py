"""The graph, its builders and its subgraphs."""

import numpy as np
import pytest
from paper_instances import smoothness_edges
from small_graphs import table

from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.papers import PointGraph, SkeletalStructure, bone_edges, frame_edges, pair_edges, trace_edges
from robot_retarget.papers.build import empty, motion_graph
from robot_retarget.papers.edges import INTERACTION
from robot_retarget.papers.skeletal import structure_from_pose

RNG = np.random.default_rng(7)


def triangle(**changes: object) -> PointGraph:
    return table(("a", "b", "c"), 2, **(dict(i=[0, 1, 0], j=[1, 2, 2], lower=1.0, upper=1.0) | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(lower=[1, -0.5, 1]), "posture b – c has a lower bound that is negative or infinite at frame 0: -0.5 … 1"),
        (dict(lower=[1, 1, 2]), "posture a – c has no interval at frame 0: 2 … 1"),
        (dict(lower=[1, np.nan, 1]), "posture b – c has no interval at frame 0: nan … 1"),
        (dict(upper=[np.nan, 1, 1]), "posture a – b has no interval at frame 0: 1 … nan"),
        (dict(priority=[1, 1, -1]), "posture a – c has a priority that is no number of 0 or more"),
        (dict(priority=[1, np.nan, 1]), "posture b – c has a priority that is no number of 0 or more"),
        (dict(j=[1, 1, 2]), "posture b – b joins a vertex to itself"),
        (dict(box_lower=np.inf, box_upper=0.0), r"vertex a@0 has an empty box"),
    ],
)
def test_bad_tables_name_the_edge(changes: dict[str, object], message: str) -> None:
    with pytest.raises(GraphError, match=message):
        triangle(**changes)


def test_an_edge_is_absent_where_its_stencil_leaves_the_frames() -> None:
    x = RNG.normal(size=(4, 2, 3))
    near = pair_edges(empty(("a", "b"), x)[0], [("a", "b")], 0.1, kind=INTERACTION)
    assert [near.edges.name(edge) for edge in range(len(near.edges))] == ["a@1–b@1", "a@2–b@2", "a@3–b@3"]
    assert not len(near.at_frame(2).edges) and len(near.induced([0, 1], 1, 2).edges) == 1
    assert len(smoothness_edges(("a", "b"), x).edges) == 2 * 2


def test_realization_of_another_dimension_is_refused() -> None:
    with pytest.raises(GraphError, match="realization has K = 3, the graph K = 2"):
        triangle().checked(np.zeros((3, 3)))


def test_realization_that_is_not_finite_names_the_vertex() -> None:
    with pytest.raises(GraphError, match="vertex b@0"):
        triangle().checked([[0, 0], [np.nan, 0], [1, 1]])


def test_unknown_vertex_lists_the_known_ones() -> None:
    with pytest.raises(GraphError, match="unknown vertex 'z'; known: a, b, c"):
        triangle().place("z")
    with pytest.raises(GraphError, match="unknown vertex 'z'; known: a, b, c"):
        pair_edges(triangle(), [("a", "z")], 0.1)


def test_edge_tables_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        triangle().edges.lower[0] = 3.0


@pytest.mark.parametrize(("frames", "depth"), [(10, 3), (7, 6), (5, 1)])
def test_trace_edges_are_every_pair_within_the_depth(frames: int, depth: int) -> None:
    graph = trace_edges(("a", "b"), RNG.normal(size=(frames, 2, 3)), depth)
    assert len(graph.edges) == 2 * depth * (2 * frames - depth - 1) // 2
    window = graph.induced(1, frames - 1 - depth, frames - 1)
    assert len(window.edges) == depth * (depth + 1) // 2
    assert set(map(tuple, np.sort(np.stack([window.edges.i, window.edges.j], 1)))) == {
        (p, q) for p in range(depth + 1) for q in range(p + 1, depth + 1)
    }


def test_trace_depth_beyond_the_animation_is_refused() -> None:
    with pytest.raises(UsageError, match="depth must be 1 … 4 for 5 frames"):
        trace_edges(("a",), RNG.normal(size=(5, 1, 2)), 5)


def test_subgraph_of_a_frame_is_the_posture() -> None:
    x = RNG.normal(size=(4, 5, 3))
    names = tuple("abcde")
    graph = frame_edges(names, x).joined(trace_edges(names, x))
    posture = graph.at_frame(2)
    assert (posture.frames, len(posture.edges), posture.vertices) == (1, 10, names)
    pairs = np.linalg.norm(x[2, posture.edges.i] - x[2, posture.edges.j], axis=-1)
    np.testing.assert_allclose(posture.edges.lower, pairs, atol=1e-15)


def test_subgraph_of_an_object_is_its_trajectory() -> None:
    x = RNG.normal(size=(6, 3, 2))
    graph = trace_edges(("a", "b", "c"), x, 2).joined(frame_edges(("a", "b", "c"), x))
    track = graph.induced(1, 0, 5)
    assert track.vertices == ("b",)
    assert set(track.edges.kind.tolist()) == {"trace 1", "trace 2"}
    np.testing.assert_allclose(
        track.edges.lower, np.linalg.norm(x[track.edges.i, 1] - x[track.edges.j, 1], axis=-1), atol=1e-15
    )


def test_induced_subgraph_keeps_boxes_and_fixed_vertices() -> None:
    fixed = np.array([[True, False, False]])
    graph = triangle(fixed=fixed, box_upper=np.arange(6.0).reshape(1, 3, 2))
    part = graph.induced([2, 0], 0, 0)
    assert part.vertices == ("c", "a")
    assert part.fixed.tolist() == [[False, True]]
    assert part.box_upper.tolist() == [[[4, 5], [0, 1]]]
    assert part.edges.name(0) == "a–c"


def test_graphs_over_other_vertices_cannot_be_joined() -> None:
    with pytest.raises(GraphError, match="different V × T"):
        triangle().joined(triangle().induced([0, 1], 0, 0))


def test_both_meanings_of_chi_convert_into_each_other() -> None:
    parents = np.array([-1, 0, 1, 1])
    structure = SkeletalStructure(tuple("abcd"), parents, RNG.normal(size=(4, 3)))
    back = structure_from_pose(structure.names, parents, structure.initial_pose)
    np.testing.assert_allclose(back.displacements, structure.displacements, atol=1e-15)


def test_joint_before_its_parent_is_named() -> None:
    with pytest.raises(GraphError, match="'b' must stand after its parent"):
        structure_from_pose(("a", "b", "c"), [-1, 2, 0], RNG.normal(size=(3, 2)))


def test_joint_on_its_parent_is_named() -> None:
    with pytest.raises(GraphError, match="'b' coincides"):
        structure_from_pose(("a", "b"), [-1, 0], np.zeros((2, 3)))


def test_bone_edges_hold_the_lengths_in_every_frame() -> None:
    structure = structure_from_pose(("a", "b", "c"), [-1, 0, 1], [[0, 0], [1, 0], [1, 2]])
    bare, _ = empty(("c", "b", "a"), np.zeros((4, 3, 2)))
    bones = bone_edges(bare, structure)
    assert len(bones.edges) == 8
    assert sorted(bones.at_frame(3).edges.lower.tolist()) == [1.0, 2.0]
    assert bones.edges.name(1) == "b@0–c@0"


def test_edges_are_walked_through_and_picked_one_by_one() -> None:
    graph = triangle(lower=[1.0, 2.0, 3.0], upper=[1.5, 2.5, 3.5])
    rows = [(edge.a, edge.b, edge.lower, edge.upper, edge.priority, edge.kind) for edge in graph.edges]
    columns = graph.edges.lower, graph.edges.upper, graph.edges.priority, graph.edges.kind
    assert [row[2:] for row in rows] == list(zip(*(column.tolist() for column in columns), strict=True))
    assert [(a, b) for a, b, *_ in rows] == [("a", "b"), ("b", "c"), ("a", "c")]
    assert graph.edges[-1] == rows[-1] and len(list(graph.edges)) == len(graph.edges) == 3
    with pytest.raises(IndexError):
        graph.edges[3]


def test_a_graph_of_points_prints_in_one_line() -> None:
    graph = motion_graph(RNG.normal(size=(40, 30, 3)))
    assert len(repr(graph)) < 200 and "30 vertices × 40 frames" in repr(graph) and len(repr(graph.edges)) < 100
