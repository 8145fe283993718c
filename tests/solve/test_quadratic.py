"""Rows of links: what a step that was refused has met is told to the next one, and a hair of the margin may lack."""

import numpy as np

from robot_retarget.graph.describe import describe
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.robot.kinematics import integrate
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.options import SolveOptions
from robot_retarget.solve.problem import EdgeTargets, build_problem, targets_of
from robot_retarget.solve.sqp import FrameSolver

TOLERATED = SolveOptions().tolerated


def asked() -> tuple[FrameSolver, EdgeTargets]:
    """The first frame of a clap."""
    graph = describe(read_motion(SAMPLES / "clap.bvh"), load_robot("op3"), fps=10)
    return FrameSolver(build_problem(graph.robot, graph.match, graph.tracks)), targets_of(graph.tracks).at(0)


def test_links_met_by_a_step_lack_as_much_to_the_model_as_they_do_there_or_are_to_stay_as_they_are() -> None:
    solver, targets = asked()
    robot, soles = solver.robot, len(solver.problem.inequalities)
    draw, met = np.random.default_rng(0), 0
    for _ in range(40):
        q = robot.standing()
        q[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        step = draw.normal(scale=0.02, size=robot.model.nv)
        here, there = (solver.costs.linearize(pose, targets) for pose in (q, integrate(robot, q, step)))
        lacking = there.row_lower[soles:][there.row_lower[soles:] > 0]
        told = here.with_rows_met(soles, there, step)
        changed = np.flatnonzero((told.rows != here.rows).any(axis=1) | (told.row_lower != here.row_lower))
        assert (changed >= soles).all() and len(changed) == len(lacking)
        stays = np.equal(told.row_lower[changed], max(here.row_lower[soles:].max(), 0.0))
        lacks = (told.row_lower - told.rows[:, :-1] @ step)[changed]
        assert np.asarray(np.isclose(lacks[:, None], lacking, atol=1e-12).any(axis=1))[~stays].all()
        assert (told.row_lower[changed] <= max(here.row_lower[soles:].max(), 0.0)).all()
        kept = np.setdiff1d(np.arange(len(here.row_lower)), changed)
        assert (
            here.row_lower[changed] <= here.row_lower[np.setdiff1d(kept, np.arange(soles))].min(initial=np.inf)
        ).all()
        met += int((~stays).sum())
    assert met > 20


def test_links_that_lack_a_hair_of_their_margin_may_stay_and_others_are_parted_wholly() -> None:
    (solver, targets), draw = asked(), np.random.default_rng(0)
    robot, costs, soles = solver.robot, solver.costs, len(solver.problem.inequalities)
    stayed = parted = 0
    for _ in range(40):
        apart, near = robot.standing(), robot.standing()
        near[robot.qpos_index] = draw.uniform(robot.lower, robot.upper)
        for _ in range(14):  # halve the way to where links lack half of what is tolerated
            q = (apart + near) / 2
            rows = costs.near(q, targets)
            assert rows is not None
            lacking = rows.deficit.max(initial=0.0) / solver.leg
            here = costs.linearize(q, targets)
            may_stay = bool((here.row_lower[soles:] <= 0).all())
            assert may_stay == (lacking <= TOLERATED) == (here.clearance_deficit == 0)
            if not may_stay:
                assert np.isclose(here.row_lower[soles:].max(), lacking * solver.leg)
                assert np.isclose(here.clearance_deficit, lacking - TOLERATED)
            stayed, parted = stayed + (0 < lacking <= TOLERATED), parted + (not may_stay)
            apart, near = (q, near) if lacking < TOLERATED / 2 else (apart, q)
    assert stayed > 20 and parted > 20
