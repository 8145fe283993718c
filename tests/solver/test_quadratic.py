"""Rows of links: what a step that was refused has met is told to the next one, and a hair of the margin may lack."""

import numpy as np

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.limits import Targets, targets_of
from robot_retarget.solver.options import SolveOptions
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.sqp import FrameSolver

TOLERATED = SolveOptions().tolerated


def asked() -> tuple[FrameSolver, Targets]:
    """The first frame of a clap."""
    graph = describe(read_motion(SAMPLES / "clap.bvh"), load_robot("op3"), fps=10)
    return FrameSolver(build_problem(graph.robot, graph.match, graph.tracks)), targets_of(graph.tracks).at(
        np.array([0])
    )


def test_links_that_lack_a_hair_of_their_margin_may_stay_and_others_are_parted_wholly() -> None:
    (solver, targets), draw = asked(), np.random.default_rng(0)
    robot, costs, soles = solver.robot, solver.costs, len(solver.problem.inequalities)
    stayed = parted = 0
    for _ in range(40):
        apart, near = robot.standing(), robot.standing()
        near[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        for _ in range(14):  # halve the way to where links lack half of what is tolerated
            q = (apart + near) / 2
            lacking = costs.near(q, targets.at(0)).deficit.max(initial=0.0) / solver.leg
            here = costs.linearize(q[None], targets)
            asked_for = costs.tolerant(here.row_lower)[0, soles:]
            may_stay = bool((asked_for <= 0).all())
            assert may_stay == (lacking <= TOLERATED) == (here.clearance_deficit[0] == 0)
            if not may_stay:
                assert np.isclose(asked_for.max(), lacking * solver.leg)
                assert np.isclose(here.clearance_deficit[0], lacking - TOLERATED)
            stayed, parted = stayed + (0 < lacking <= TOLERATED), parted + (not may_stay)
            apart, near = (q, near) if lacking < TOLERATED / 2 else (apart, q)
    assert stayed > 20 and parted > 20
