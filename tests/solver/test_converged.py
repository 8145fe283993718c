"""A frame has converged once its cost has stopped falling."""

from dataclasses import replace

import numpy as np
import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.graph.track import Status
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.solve import problem_of, solve_graph

OP3 = rr.load_robot("op3")


@pytest.fixture(scope="module")
def graph() -> rr.RobotGraph:
    return rr.describe(rr.read_motion(ROOT / "samples/wave.bvh").frames(60, 110), OP3)


def test_every_frame_of_a_sample_converges(graph: rr.RobotGraph) -> None:
    assert set(rr.solve(graph, balance="off").solution.status) == {Status.CONVERGED}


def test_more_passes_lower_the_cost_of_frames_that_have_not_converged_only(graph: rr.RobotGraph) -> None:
    strict = Smoothing(rounds=1, passes=1, collision_check=-1, extra=0, converged=1e-6)
    short = rr.solve(graph, smoothing=strict, balance="off").solution
    longer = rr.solve(graph, smoothing=replace(strict, extra=30), balance="off").solution
    unsettled = np.array([status is Status.OUT_OF_ITERATIONS for status in short.status])
    assert unsettled.any()
    assert longer.cost.sum() < short.cost.sum()
    assert set(longer.status) == {Status.CONVERGED}


def test_over_relaxed_passes_come_nearer_to_the_least_cost_and_its_smooth_path() -> None:
    walk = rr.describe(rr.read_motion(ROOT / "samples/walk.bvh").frames(0, 90), OP3)
    plain, relaxed = (
        rr.solve(walk, smoothing=Smoothing(rounds=1, extra=0, relaxation=alpha), balance="off").solution
        for alpha in (1.0, Smoothing().relaxation)
    )
    assert relaxed.cost.sum() < plain.cost.sum()
    assert relaxed.stress["smoothness"].sum() < 0.97 * plain.stress["smoothness"].sum()


@pytest.mark.parametrize("clip", ["walk", "wave"])
def test_neither_more_passes_nor_another_start_from_the_result_lower_the_cost(clip: str) -> None:
    walk = rr.describe(rr.read_motion(ROOT / f"samples/{clip}.bvh").frames(0, 90), OP3).unbalanced()
    problem = problem_of(walk)
    solved = solve_graph(walk, problem=problem)
    again = solve_graph(walk, problem=problem, start=solved.trajectory.qpos)
    longer = solve_graph(walk, problem=problem, smoothing=Smoothing(passes=16))
    least = min(again.cost.sum(), longer.cost.sum())
    assert solved.cost.sum() < 1.002 * least
