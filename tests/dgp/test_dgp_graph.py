"""The graph, its builders and its subgraphs."""

import numpy as np
import pytest
from small_graphs import table

from robot_retarget.dgp import (
    Graph,
    Kind,
    SkeletalStructure,
    bone_edges,
    frame_edges,
    pair_edges,
    structure_from_pose,
    threshold_edges,
    trace_edges,
)
from robot_retarget.dgp.build import empty
from robot_retarget.errors import GraphError, UsageError

RNG = np.random.default_rng(7)


def triangle(**changes: object) -> Graph:
    return table(("a", "b", "c"), 1, 2, **(dict(i=[0, 1, 0], j=[1, 2, 2], lower=1.0, upper=1.0) | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(lower=[1, -0.5, 1]), r"edge 1 \(b–c\) has a negative lower bound"),
        (dict(lower=[1, 1, 2]), r"edge 2 \(a–c\) has lower > upper"),
        (dict(lower=[1, np.nan, 1]), r"edge 1 \(b–c\) has lower NaN"),
        (dict(upper=[np.nan, 1, 1]), r"edge 0 \(a–b\) has upper NaN"),
        (dict(priority=[1, 1, -1]), r"edge 2 \(a–c\) has a priority outside"),
        (dict(j=[1, 2, 3]), r"edge 2 joins ids 0 and 3.*known: a, b, c"),
        (dict(j=[1, 1, 2]), r"edge 1 \(b–b\) joins a vertex to itself"),
        (dict(lower=[1, 2]), r"lower must be a scalar or \(3,\)"),
        (dict(kind=Kind.INTERACTION), r"edge 0 \(a–b\) is an interaction in the first frame"),
        (dict(box_lower=np.inf, box_upper=0.0), r"vertex a@0 has an empty box"),
    ],
)
def test_bad_tables_name_the_edge(changes: dict[str, object], message: str) -> None:
    with pytest.raises(GraphError, match=message):
        triangle(**changes)


def test_interaction_across_frames_is_refused() -> None:
    with pytest.raises(GraphError, match=r"a@0–b@1.*across two frames"):
        table(("a", "b"), 2, 2, [0], [3], [1.0], [1.0], kind=Kind.INTERACTION)


def test_realization_of_another_dimension_is_refused() -> None:
    with pytest.raises(GraphError, match="realization has K = 3, the graph K = 2"):
        triangle().checked(np.zeros((3, 3)))


def test_realization_that_is_not_finite_names_the_vertex() -> None:
    with pytest.raises(GraphError, match="vertex b@0"):
        triangle().checked([[0, 0], [np.nan, 0], [1, 1]])


def test_unknown_vertex_lists_the_known_ones() -> None:
    with pytest.raises(GraphError, match="unknown vertex 'z'; known: a, b, c"):
        triangle().vertex("z")
    with pytest.raises(GraphError, match="unknown vertex 'z'; known: a, b, c"):
        pair_edges(triangle(), [("a", "z")], 0.1)


def test_edge_tables_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        triangle().lower[0] = 3.0


@pytest.mark.parametrize(("frames", "depth"), [(10, 3), (7, 6), (5, 1)])
def test_trace_edges_are_every_pair_within_the_depth(frames: int, depth: int) -> None:
    graph = trace_edges(("a", "b"), RNG.normal(size=(frames, 2, 3)), depth)
    assert len(graph) == 2 * depth * (2 * frames - depth - 1) // 2
    window = graph.of_vertex("b", frames - 1 - depth, frames - 1)
    assert len(window) == depth * (depth + 1) // 2
    assert set(map(tuple, np.sort(np.stack([window.i, window.j], 1)))) == {
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
    assert (posture.frames, len(posture), posture.vertices) == (1, 10, names)
    pairs = np.linalg.norm(x[2, posture.i] - x[2, posture.j], axis=-1)
    np.testing.assert_allclose(posture.lower, pairs, atol=1e-15)


def test_subgraph_of_an_object_is_its_trajectory() -> None:
    x = RNG.normal(size=(6, 3, 2))
    graph = trace_edges(("a", "b", "c"), x, 2).joined(frame_edges(("a", "b", "c"), x))
    track = graph.of_vertex("b")
    assert track.vertices == ("b",)
    assert (track.kind == Kind.TRACE).all()
    np.testing.assert_allclose(track.lower, np.linalg.norm(x[track.i, 1] - x[track.j, 1], axis=-1), atol=1e-15)


def test_induced_subgraph_keeps_boxes_and_fixed_vertices() -> None:
    fixed = np.array([[True, False, False]])
    graph = triangle(fixed=fixed, box_upper=np.arange(6.0).reshape(1, 3, 2))
    part = graph.induced([2, 0], 0, 0)
    assert part.vertices == ("c", "a")
    assert part.fixed.tolist() == [[False, True]]
    assert part.box_upper.tolist() == [[[4, 5], [0, 1]]]
    assert part.edge_name(0) == "a–c"


def test_thresholds_take_the_pairs_that_are_too_close() -> None:
    x = np.array([[[0, 0], [1, 0]], [[0, 0], [0.1, 0]], [[0, 0], [0.05, 0]]], dtype=float)
    bare, _ = empty(("a", "b"), x)
    chosen = threshold_edges(pair_edges(bare, [("a", "b")], 0.1), x)
    assert [chosen.edge_name(edge) for edge in range(len(chosen))] == ["a@1–b@1", "a@2–b@2"]
    assert (chosen.upper == np.inf).all()


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
    assert len(bones) == 8
    assert sorted(bones.at_frame(3).lower.tolist()) == [1.0, 2.0]
    assert bones.edge_name(1) == "b@0–c@0"
