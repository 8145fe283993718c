"""The graph of a retargeting expands to the papers' graph of free points: equal stress, equal minimum."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.human.read import read_motion
from robot_retarget.papers import Ipopt, distances, solve, stress
from robot_retarget.papers.points import expanded
from robot_retarget.robot import load_robot, world_points
from robot_retarget.solver.solve import solve_graph

PLACE = np.array([0.2, 0.0, 0.5])
FRAMES = 4
POINTS = ("posture", "touch", "own")
"""Kinds that measure distances of two points."""


@cache
def clap() -> RobotGraph:
    graph = describe(read_motion(SAMPLES / "clap.bvh"), load_robot("op3"), fps=15).frames(30, 30 + FRAMES)
    graph = graph.with_edge("l_hand", "head", (0.02, 0.1), priority=7.0, frames=(1, 2))
    return graph.with_edge("r_hand", PLACE, 0.3, hard=True).with_edge(("head_tilt_link", (0, 0, 0.1)), "r_knee", 0.1)


def described(graph: RobotGraph, x: np.ndarray) -> float:
    """Σ π ϱ(e) of points (T, V, 3) by the tracks' own loss, from the names of their ends."""
    places = np.concatenate([x, np.tile(PLACE, (len(x), 1, 1))], axis=1)
    names, total = (*graph.match.keypoints, "(0.2, 0, 0.5)"), 0.0
    for track in (graph.kinds[kind] for kind in POINTS):
        known = track.subset(np.array([set(ends) <= set(names) for ends in track.ends]))
        a, b = np.array([[names.index(end) for end in ends] for ends in known.ends]).T
        d = np.linalg.norm(places[:, a] - places[:, b], axis=-1)
        error = (d - np.clip(d, known.lower, known.upper)) / known.scale
        g = known.huber_delta
        loss = error**2 if np.isinf(g) else 2 * g**2 * (np.sqrt(1 + (error / g) ** 2) - 1)
        total += float((known.priority * loss).sum())
    return total


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_stress_of_any_points_is_the_same_both_ways(seed: int) -> None:
    graph, instance = clap(), expanded(clap())
    x = np.random.default_rng(seed).normal(scale=0.3, size=(FRAMES, len(graph.match.keypoints), 3))
    placed = np.concatenate([x, np.tile(PLACE, (FRAMES, 1, 1))], axis=1)
    free = instance.without("bone")
    assert stress(free, placed) == pytest.approx(described(graph, x), rel=1e-12)


def test_the_solved_robot_has_the_stress_that_its_solution_reports() -> None:
    graph = clap().without(("head_tilt_link@(0, 0, 0.1)", "r_knee"))
    solution = solve_graph(graph)
    instance = expanded(solution.graph)
    x = world_points(graph.robot, graph.match.points, solution.trajectory.qpos)
    hips = [graph.match.index(f"{side}_hip") for side in "lr"]
    x[:, graph.match.index("pelvis")] = x[:, hips].mean(axis=1)
    placed = np.concatenate([x, np.tile(PLACE, (FRAMES, 1, 1))], axis=1)
    free = instance.without("bone")
    told = sum(float(solution.stress[kind].sum()) for kind in POINTS)
    assert stress(free, placed) == pytest.approx(told, rel=1e-6)


def test_a_small_instance_without_a_robot_has_one_minimum_both_ways() -> None:
    """The tracks' own loss minimised over free points by BFGS, and the expansion by `papers.solve`."""
    graph = clap().at(np.array([1]))
    points, start = len(graph.match.keypoints), graph.human.positions * graph.match.leg_ratio
    instance = expanded(graph)
    instance = instance.without("bone")
    placed = np.concatenate([start, np.tile(PLACE, (1, 1, 1))], axis=1)
    found = solve(instance, placed, Ipopt(()))
    near = found.positions[:, :-1] + np.random.default_rng(0).normal(scale=0.003, size=start.shape)
    own = minimize(
        lambda z: described(graph, z.reshape(1, points, 3)), near.ravel(), method="BFGS", options={"gtol": 1e-6}
    )
    there = np.concatenate([own.x.reshape(1, points, 3), placed[:, -1:]], axis=1)
    assert solve(instance, there, Ipopt(())).stress == pytest.approx(
        own.fun, rel=1e-5
    )  # BFGS ended at a minimum of both
    assert found.stress == pytest.approx(own.fun, rel=1e-3)
    assert 1e-4 < found.stress < 0.5 * stress(instance, placed)
    np.testing.assert_array_equal(found.positions[0, -1], PLACE)


def test_bones_are_hard_edges_of_the_robots_own_lengths_and_the_rest_is_left_out() -> None:
    graph = clap()
    instance, match = expanded(graph), graph.match
    bones = instance.select(instance.edges.kind == "bone")
    assert len(bones.edges) == FRAMES * int((match.parents >= 0).sum())
    rest = np.concatenate([np.tile(match.rest, (FRAMES, 1, 1)), np.tile(PLACE, (FRAMES, 1, 1))], axis=1)
    np.testing.assert_allclose(distances(bones, rest), bones.edges.lower, atol=1e-12)
    ends = {instance.edges.name(e) for e in range(len(instance.edges))}
    assert {"l_hand@1–head@1", "r_hand@0–(0.2, 0, 0.5)@0"} <= ends
    assert instance.vertices == (*match.keypoints, "(0.2, 0, 0.5)")
    assert set(instance.kinds) == {"bone", *POINTS}
    present = sum(int((graph.kinds[kind].priority > 0).sum()) for kind in POINTS)
    assert len(instance.edges) == len(bones.edges) + present - FRAMES  # the point that the head carries is no vertex
