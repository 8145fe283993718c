"""The solver minimises and enforces the edges of the graph, and nothing else; a new kind is one class and one line."""

from functools import cache

import numpy as np
import pytest

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, describe
from robot_retarget.graph.kinds import KINDS, STREAM_KINDS
from robot_retarget.graph.track import SECOND_DIFFERENCE, Role
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.distances import Separation
from robot_retarget.solver.balance.balanced_ik import BalancedIk, BalanceOptions
from robot_retarget.solver.solution import Solution
from robot_retarget.solver.solve import solve_graph


@cache
def graph(clip: str = "wave", first: int = 40, last: int = 70) -> RobotGraph:
    return describe(read_motion(SAMPLES / f"{clip}.bvh").frames(first, last), load_robot("op3"))


def hinges(solution: Solution) -> Floats:
    return solution.trajectory.qpos[:, solution.graph.robot.qpos_index]


def test_every_track_has_a_role_and_a_stencil_and_is_in_the_table() -> None:
    assert {track.name for track in graph().tracks} <= {kind.name for kind in KINDS}
    kinds = {row["kind"] for row in graph().table(3)}
    assert {"posture", "smoothness", "floor", "separation", "range", "speed"} <= kinds
    assert all(isinstance(track.role, Role) and 0 in track.stencil for track in graph().tracks)


def test_the_margin_of_separation_is_read_from_the_graph() -> None:
    """Both feet beside each other: as near as the margin of the graph lets them be."""
    robot, nearest = graph().robot, []
    surfaces = Separation(robot, 0.1)
    for margin in (0.002, 0.02):
        found = solve_graph(graph("hips_and_bow", 30, 60).with_bounds("separation", lower=margin))
        near = surfaces.distances(found.trajectory.qpos)
        nearest.append(near.distance[surfaces.rest[*near.geoms.T] > margin].min(initial=np.inf))
    assert nearest[0] < 0.012 and nearest[1] > 0.014


def test_a_share_of_the_joint_speeds_and_a_narrower_range_are_read_from_the_graph() -> None:
    slow = graph().with_bounds("speed", factor=0.25).with_bounds(("l_el", "zero"), lower=0.2)
    found, robot = solve_graph(slow), slow.robot
    speed = np.abs(np.diff(hinges(found), axis=0)) * slow.fps
    assert (speed <= 0.25 * robot.max_speed + 1e-6).all() and speed.max() > 0.2 * robot.max_speed.min()
    assert hinges(found)[:, robot.joint_names.index("l_el")].min() >= 0.2 - 1e-9


def test_smoothness_is_weighed_and_dropped_like_any_other_kind() -> None:
    graphs = graph().with_priority("smoothness", 10), graph(), graph().without("smoothness")
    bends = [float(np.abs(np.diff(hinges(solve_graph(each)), n=2, axis=0)).mean()) for each in graphs]
    assert bends[0] < bends[1] < bends[2]
    assert "smoothness" not in solve_graph(graph().without("smoothness")).stress


def test_without_separation_and_floor_there_are_no_such_rows() -> None:
    found = solve_graph(graph().without("separation").without("floor"))
    assert not {"separation", "floor"} & found.graph.kinds.keys() and "separation" not in found.stress


def test_balance_shows_the_margins_and_knees_that_it_uses() -> None:
    planted, options = BalancedIk(graph()).graph, BalanceOptions()
    margins = planted.kinds["separation"].lower[0] / planted.match.robot_leg
    ends, legs = planted.kinds["separation"].ends, ("hip", "knee", "ank")
    between = np.array([b != "floor" for _, b in ends])
    two = np.array([all(any(part in end for part in legs) for end in pair) for pair in ends])
    assert set(np.round(margins[between & two], 6)) == {options.legs}
    assert set(np.round(margins[between & ~two], 6)) == {options.margin}
    knee = [name for name, _ in planted.kinds["range"].ends].index("l_knee")
    bounds = planted.kinds["range"].lower[0, knee], planted.kinds["range"].upper[0, knee]
    assert min(abs(bound) for bound in bounds) == pytest.approx(options.bent)


def test_the_temporal_cost_of_a_stream_is_a_kind_too() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 20), load_robot("op3")
    tracks = describe(motion, robot, kinds=STREAM_KINDS).kinds
    assert "inertia" in tracks and not any(track.stencil == SECOND_DIFFERENCE for track in tracks.values())
