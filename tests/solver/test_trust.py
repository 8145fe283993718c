"""The figures of a solution are right: its cost is the sum of its stresses, and added edges meet their targets."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shared_files import SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.kinds.posture import PostureKind
from robot_retarget.graph.symbolic_robot import drawn_configurations
from robot_retarget.graph.track import Status, Track
from robot_retarget.human.read import read_motion
from robot_retarget.papers import Objective, PointGraph, stress
from robot_retarget.robot import Points, load_robot, world_points
from robot_retarget.robot.kinematics import difference
from robot_retarget.solver.limits import targets_of
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solve_graph

TODDLER = SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml"
FIRST, LAST = 30, 50
NEAR = 0.08
"""A hand of the OP3 comes no nearer to the middle of its head than 5.9 cm [m]."""


@cache
def wave() -> RobotGraph:
    return describe(read_motion(SAMPLES / "wave.bvh"), load_robot("op3"), fps=15)


def apart(solution: Solution, a: str = "r_hand", b: str = "head") -> np.ndarray:
    """(T,) how far two keypoints are from each other, by MuJoCo [m]."""
    match = solution.graph.match
    x = world_points(solution.graph.robot, match.points, solution.trajectory.qpos)
    return np.linalg.norm(x[:, match.index(a)] - x[:, match.index(b)], axis=1)


def check_sum(solution: Solution) -> None:
    """Σ over kinds of π ϱ(e) from what was measured, and smoothness by second and third differences, against the cost."""
    graph, qpos = solution.graph, solution.trajectory.qpos
    total = np.zeros(len(graph))
    for track in graph.costs:
        d = solution.measured[track.name]
        e = (d - np.minimum(np.maximum(d, track.lower), track.upper)) / track.scale
        g = track.huber_delta
        loss = e**2 if np.isinf(g) else 2 * g**2 * (np.sqrt(1 + (e / g) ** 2) - 1)
        own = (track.priority * loss).sum(axis=1)
        assert np.allclose(solution.stress[track.name], own, rtol=1e-9, atol=1e-12)
        total += own
    weight = np.full(graph.robot.model.nv, graph.weights.smooth)
    weight[:3] *= graph.weights.smooth_root  # a free root: metres, then radians
    weight[3:6] *= graph.weights.smooth_turn
    speed = np.array([difference(graph.robot, a, b) for a, b in pairwise(qpos)])
    away = np.diff(speed, axis=0) - graph.kinds["smoothness"].lower[1:-1]
    bend = (weight * (graph.fps / 30) ** 4 * away**2).sum(axis=1)
    assert np.allclose(solution.stress["smoothness"][1:-1], bend, rtol=1e-9)
    total[1:-1] += bend
    weight = np.full(graph.robot.model.nv, graph.weights.jerk)
    weight[:3] *= graph.weights.smooth_root
    away = np.diff(speed, 2, axis=0) - graph.kinds["jerk"].lower[1:-2]
    jerk = (weight * (graph.fps / 30) ** 6 * away**2).sum(axis=1)
    assert np.allclose(solution.stress["jerk"][1:-2], jerk, rtol=1e-6)
    total[1:-2] += jerk
    total += sum(solution.stress.get(kind, 0.0) for kind in ("separation", "coupling", "interaction"))
    assert np.allclose(solution.cost, total, rtol=1e-9, atol=0)
    assert np.allclose(solution.cost, sum(solution.stress.values()), rtol=1e-9, atol=0)
    problem, all_targets = build_problem(graph.robot, graph.match, graph.tracks), targets_of(graph.tracks)
    alone = sum(solution.stress[track.name] for track in graph.costs)
    assert np.allclose(alone, [problem.cost(q, all_targets.at(t)) for t, q in enumerate(qpos)], rtol=1e-9, atol=0)


def test_the_cost_of_every_frame_is_the_sum_of_the_stresses_of_all_kinds() -> None:
    graph = wave().with_edge("r_hand", "head", (0.1, 0.12), frames=(FIRST, LAST)).frames(20, 60)
    solution = solve_graph(graph)
    check_sum(solution)
    assert solution.stress["own"].max() > 0


@needs_shared
def test_so_it_is_where_joints_are_coupled_and_links_too_near() -> None:
    graph = describe(read_motion(SAMPLES / "clap.bvh").frames(60, 90), load_robot(TODDLER), fps=15)
    solution = solve_graph(graph, smoothing=Smoothing(steps=2, rounds=()))
    check_sum(solution)
    assert (np.asarray(solution.stress.get("coupling", 0.0)) >= 0).all() and (solution.stress["separation"] >= 0).all()


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_stress_without_a_robot_is_that_of_distance_geometry(seed: int, open_intervals: bool) -> None:
    """Posture edges of scale 1 and quadratic throughout sum up π (d − y)², as tracks and as a graph of points."""
    draw, points, names = np.random.default_rng(seed), 6, tuple("abcdef")
    i, j = np.triu_indices(points, 1)
    lower = draw.uniform(0.1, 2.0, len(i))
    upper = lower + draw.uniform(0.0, 0.5, len(i)) * open_intervals
    priority, x = draw.uniform(0.0, 9.0, len(i)), draw.normal(size=(1, points, 3))
    apart = np.sqrt(np.square(x[0, i] - x[0, j]).sum(axis=1))
    outside = np.maximum(lower - apart, 0.0) + np.maximum(apart - upper, 0.0)
    ends = tuple((names[a], names[b]) for a, b in zip(i, j, strict=True))
    track = Track(PostureKind(), ends, lower[None], upper[None], priority[None], np.ones(len(i)))
    for found in (track.stress(apart[None]).sum(), stress(PointGraph((track,), names, 1, 3), x, Objective.SQUARED)):
        assert found == pytest.approx((priority * outside**2).sum(), rel=1e-12)


@pytest.mark.parametrize("hand", ["l_hand", "r_hand"])
def test_a_hard_edge_holds_within_a_millimetre_while_it_is_asked_for(hand: str) -> None:
    """The right hand waves beside the head, the left one hangs."""
    before = solve_graph(wave())
    after = solve_graph(wave().with_edge(hand, "head", NEAR, frames=(FIRST, LAST), hard=True))
    asked = slice(FIRST, LAST + 1)
    assert np.abs(apart(before, hand)[asked] - NEAR).min() > 0.03
    assert np.abs(apart(after, hand)[asked] - NEAR).max() < 1e-3
    assert Status.UNREACHED not in after.status
    assert after.cost[0] < 1.01 * before.cost[0] and after.cost[-1] < 1.01 * before.cost[-1]
    elsewhere = np.r_[0 : FIRST - 15, LAST + 16 : len(before.status)]
    hinges = wave().robot.qpos_index
    assert np.abs(after.trajectory.qpos - before.trajectory.qpos)[np.ix_(elsewhere, hinges)].max() < 0.05


def test_what_cannot_be_reached_is_said_and_come_as_near_to_as_can_be() -> None:
    graph = wave().with_edge("r_hand", "head", 0.55, frames=(FIRST, LAST), hard=True)
    solution = solve_graph(graph)
    told = [t for t, status in enumerate(solution.status) if status is Status.UNREACHED]
    assert told == list(range(FIRST, LAST + 1))
    names, drawn = graph.match.keypoints, drawn_configurations(graph.robot, 2000)
    x = world_points(graph.robot, graph.match.points, drawn)
    longest = np.linalg.norm(x[:, names.index("r_hand")] - x[:, names.index("head")], axis=1).max()
    assert apart(solution)[FIRST : LAST + 1].min() > 0.97 * longest
    assert "cannot be reached" in Status.UNREACHED.value


def test_a_soft_edge_is_the_nearer_to_what_it_asks_the_more_it_counts() -> None:
    missed = []
    for priority in (None, 6.25, 25.0, 100.0):
        graph = wave().frames(20, 60)
        if priority is not None:
            graph = graph.with_edge("r_hand", "head", 0.05, frames=(10, 30), priority=priority)
        missed.append(np.abs(apart(solve_graph(graph))[10:31] - 0.05).mean())
    assert all(more > less + 1e-3 for more, less in pairwise(missed))


def test_an_interval_asks_for_nothing_within_it() -> None:
    graph = wave().frames(20, 60)
    free, wide = (solve_graph(g) for g in (graph, graph.with_edge("r_hand", "head", (0.0, 2.0))))
    assert (wide.stress["own"] == 0).all()
    assert np.abs(free.trajectory.qpos - wide.trajectory.qpos).max() < 1e-6
    asked = solve_graph(graph.with_edge("r_hand", "head", (0.25, np.inf), priority=1e3))
    assert apart(asked)[5:].min() > 0.24 > apart(free).min() + 0.05


def test_an_edge_to_a_place_in_the_world_leads_a_point_of_a_body_there() -> None:
    """A point on the right forearm, to where it is led from by the wave."""
    graph, point = wave().frames(20, 60), ("r_el_link", np.array([0.0, -0.05, 0.0]))
    body = graph.robot.model.body(point[0]).id
    free = solve_graph(graph).trajectory.qpos
    place = np.add(world_place(graph, body, point[1], free[20]), [0.03, 0.02, -0.04])
    found = solve_graph(graph.with_edge(point, place, 0.0, frames=(18, 22), hard=True)).trajectory.qpos
    away = [np.linalg.norm(world_place(graph, body, point[1], q) - place) for q in found[18:23]]
    assert max(away) < 1e-3


def world_place(graph: RobotGraph, body: int, offset: np.ndarray, q: np.ndarray) -> np.ndarray:
    """(3,) of a point on a body, by MuJoCo [m]."""
    return world_points(graph.robot, Points(np.array([body]), np.array([offset])), q[None])[0, 0]
