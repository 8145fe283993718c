"""Edges that a user adds: several of the same ends, hard ones that cannot be met, and the reasons given."""

import inspect
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from forked import run
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.errors import GraphError, UsageError
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.track import Status
from robot_retarget.graph.weights import Weights
from robot_retarget.robot import load_robot, world_points
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solve_graph

WAVE = ROOT / "samples/wave.bvh"
HANDS = "l_hand", "head"


@cache
def wave() -> RobotGraph:
    return describe(rr.read_motion(WAVE).frames(0, 30), load_robot("op3"))


def distance(solution: Solution) -> np.ndarray:
    """(T,) hand to head, by MuJoCo [m]."""
    names = wave().match.keypoints
    x = world_points(wave().robot, wave().match.points, solution.trajectory.qpos)
    return np.linalg.norm(x[:, names.index("l_hand")] - x[:, names.index("head")], axis=1)


def test_two_edges_of_the_same_ends_hold_each_in_its_own_frames() -> None:
    graph = wave().with_edge(*HANDS, 0.15, frames=(4, 8), hard=True).with_edge(*HANDS, 0.25, frames=(20, 25), hard=True)
    apart = distance(solve_graph(graph))
    assert np.allclose(apart[7:9], 0.15, atol=2e-3) and np.allclose(apart[22:26], 0.25, atol=2e-3)


def test_equal_edges_are_one_edge_with_the_frames_of_both() -> None:
    apart = wave().with_edge(*HANDS, 0.15, frames=(4, 8)).with_edge("head", "l_hand", 0.15, frames=(24, 28))
    priority = apart.kinds["own"].priority
    assert priority.shape[1] == 1 and (priority[4:9] == 100).all() and (priority[24:29] == 100).all()
    assert (priority[16] == 0).all()


@pytest.mark.parametrize(
    ("at", "reason"),
    [(0.02, r"head_tilt_link and l_el_link are at their separation"), (0.5, "at its extremum")],
)
def test_a_hard_edge_that_cannot_be_met_is_reported_with_its_reason(at: float, reason: str) -> None:
    solution = solve_graph(wave().with_edge(*HANDS, at, frames=(15, 20), hard=True))
    (unmet,) = solution.unmet
    assert unmet.frames == tuple(range(15, 21)) and reason in unmet.sentence
    assert unmet.measured == pytest.approx(distance(solution)[unmet.frame], abs=1e-6)
    assert {solution.status[t] for t in unmet.frames} == {Status.UNREACHED}


def test_a_hard_edge_that_comes_too_soon_names_the_joint_at_its_speed_limit() -> None:
    graph = (
        wave().with_edge(*HANDS, 0.12, frames=(12, 12), hard=True).with_edge(*HANDS, 0.3, frames=(15, 15), hard=True)
    )
    assert any("at its speed limit" in edge.sentence for edge in solve_graph(graph).unmet)


def test_footholds_out_of_reach_are_reported_by_the_same_mechanism() -> None:
    graph = wave()
    track = graph.kinds["foothold"]
    far = np.array(track.lower)
    far[:, 2] += 0.02  # a corner of a sole over the others
    raised = type(track)(track.kind, track.ends, far, far, track.priority, track.scale, track.axes)
    tracks = tuple(raised if t is track else t for t in graph.tracks)
    solution = solve_graph(replace(graph, tracks=tracks))
    assert {edge.kind for edge in solution.unmet} == {"foothold"}


def test_a_foot_that_steps_off_its_foothold_is_reported_where_it_would_stand() -> None:
    """The other feet stand: they move their places by as much as the edge needs."""
    near, far = (solve_graph(wave().with_edge("l_toe", "r_toe", d, frames=(12, 20), hard=True)) for d in (0.14, 0.3))
    assert not near.unmet
    steps = [edge for edge in far.unmet if edge.kind == "foothold"]
    stepping = {frame for edge in steps for frame in edge.frames}
    assert set(range(12, 21)) <= stepping <= {k for k, s in enumerate(far.status) if s is Status.UNREACHED}


@pytest.mark.parametrize(
    ("edge", "message"),
    [
        (lambda g: g.with_edge(*HANDS, 12), r"12 m is beyond the robot's reach; op3 can hold them 0\.\d+ m apart"),
        (lambda g: g.with_edge(*HANDS, "near"), r"`at` is a distance \[m\] or a pair .* got 'near'"),
        (lambda g: g.with_edge(*HANDS, 0.1, frames=(3.5, 9)), r"frames are whole numbers, got 3.5"),
    ],
)
def test_edges_that_make_no_sense_are_refused(edge, message: str) -> None:
    with pytest.raises(GraphError, match=message):
        edge(wave())


def test_edits_are_refused_with_their_file_and_line_and_unmet_ones_end_with_1(tmp_path: Path) -> None:
    edits = tmp_path / "EDITS.toml"
    head = '\n[[edge]]\na = "l_hand"\nb = "head"\nframes = [10, 12]\nhard = true\nat = '
    words = [
        "solve",
        WAVE,
        "--robot",
        "op3",
        "--frames",
        "0:20",
        "--balance",
        "off",
        "--edges",
        edits,
        "-o",
        tmp_path / "w.npz",
    ]
    edits.write_text(head + "12\n")
    refused = run(*words)
    assert refused.returncode == 2 and "EDITS.toml:2: " in refused.stderr.replace("\n", "")
    edits.write_text(head + "0.02\n")
    unmet = run(*words)
    assert unmet.returncode == 1 and "at its joint range (90°)" in (unmet.stdout + unmet.stderr).replace("\n", " ")


def test_without_smoothness_a_clip_is_solved_and_other_weights_below_0_are_refused() -> None:
    graph = describe(rr.read_motion(WAVE).frames(0, 12), load_robot("op3"), weights=Weights(smooth=0))
    assert np.isfinite(solve_graph(graph).trajectory.qpos).all()
    with pytest.raises(UsageError, match=r"Weights\.touch must be a number of 0 or more, got -1"):
        Weights(touch=-1)


def test_files_and_names_are_taken_for_a_motion_and_a_robot() -> None:
    result = rr.retarget(ROOT / "samples/clap.bvh", "op3", fps=10, balance="off")
    assert result.robot.name == "op3" and len(result.trajectory) == len(result.graph)


@pytest.mark.parametrize("name", ["describe", "solve", "simulate", "view", "retarget"])
def test_public_functions_show_their_signature(name: str) -> None:
    function = getattr(rr, name)
    assert inspect.isfunction(function) and "args" not in inspect.signature(function).parameters
