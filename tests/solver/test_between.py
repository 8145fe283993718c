"""Links do not pass through each other between frames either."""

from itertools import pairwise

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.distances import Separation
from robot_retarget.robot.kinematics import (
    CHECKED_TURN,
    SweptConfiguration,
    difference,
    integrate,
    swept_configurations,
)
from robot_retarget.solver.limits import Targets, targets_of
from robot_retarget.solver.pipeline import retarget
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.quadratic import Proximal
from robot_retarget.solver.sqp import FrameSolver

Asked = tuple[FrameSolver, Targets]


@pytest.fixture(scope="module")
def asked() -> Asked:
    graph = describe(read_motion(SAMPLES / "clap.bvh").frames(0, 9), load_robot("op3"), fps=10)
    return FrameSolver(build_problem(graph.robot, graph.match, graph.tracks)), targets_of(graph.tracks).at(0)


def arms(robot: Robot, pitch: float, roll: float, elbow: float) -> Floats:
    """A stand with the left arm turned so."""
    pose = robot.standing()
    for joint, angle in (("l_sho_pitch", pitch), ("l_sho_roll", roll), ("l_el", elbow)):
        pose[robot.qpos_index[robot.joint_names.index(joint)]] = angle
    return pose


def deepest(robot: Robot, qpos: Floats) -> float:
    """How deep links come inside each other at seven places between any two frames [m]."""
    separation, ways = (
        Separation(robot, 0.0),
        [(a, difference(robot, a, b)) for a, b in pairwise(qpos)],
    )
    return max(separation.depth(integrate(robot, a, k / 8 * way)) for a, way in ways for k in range(1, 8))


def test_a_way_is_looked_at_evenly_and_no_hinge_turns_far_between_two_looks(asked: Asked) -> None:
    robot, draw = asked[0].robot, np.random.default_rng(0)
    for scale in (0.01, 0.1, 0.5):
        before, after = (robot.standing(), robot.standing())
        after[robot.qpos_index] += draw.normal(scale=scale, size=len(robot.joint_names))
        looks = [before, *(way.at(robot, after) for way in swept_configurations(robot, before, after)), after]
        turned = np.abs(np.diff([q[robot.qpos_index] for q in looks], axis=0)).max(axis=1)
        assert len(looks) > 2 and turned.max() <= CHECKED_TURN and np.allclose(turned, turned[0])


def test_rows_between_frames_tell_what_a_step_of_the_frame_does_there(asked: Asked) -> None:
    solver, targets = asked
    robot, soles, step = solver.robot, len(solver.problem.inequalities), 1e-6
    way = SweptConfiguration(arms(robot, -0.5, 1.57, -1.57), 0.3)
    near = Separation(robot, solver.options.reach * solver.leg)
    q = arms(robot, -0.3, 1.57, -1.5)
    own = {tuple(row) for row in solver.costs.linearize(q[None], targets.at(None)).rows[0, soles:]}
    there = solver.costs.linearize(q[None], targets.at(None), [(way,)]).rows[0, soles:]
    rows = [row for row in there if tuple(row) not in own]
    for joint in ("l_sho_pitch", "l_sho_roll", "l_el"):
        direction = np.zeros(robot.model.nv)
        direction[column := robot.dof_index[robot.joint_names.index(joint)]] = step
        places = [way.at(robot, integrate(robot, q, sign * direction)) for sign in (1, -1)]
        ahead, behind = (near.distances(place[None]).distance for place in places)
        told, shown = np.array([row[column] for row in rows]), (ahead - behind) / (2 * step)
        told = told[np.abs(told) > 1e-6]  # of the arm, as far as there are rows for all that is near
        assert len(told) > 3 and np.abs(told[:, None] - shown).min(axis=1).max() < 1e-4


def test_a_frame_wished_beyond_links_stays_on_the_side_it_comes_from(asked: Asked) -> None:
    """The arm is wished behind the trunk and comes from before it: with the way watched it does not go through."""
    solver, targets = asked
    robot, overlap = solver.robot, solver.options.overlap
    front, back = arms(robot, -0.8, 1.57, -1.2), arms(robot, 0.9, 1.57, -1.2)
    assert solver.depths_between(front[None], back[None])[0] > 10 * overlap
    assert not solver.overlapping(front) and not solver.overlapping(back)
    drawn = Proximal(back, np.zeros(robot.model.nv), np.full(robot.model.nv, 1e3))
    through = solver.solve_frame(back, targets, proximal=drawn).qpos
    assert solver.depths_between(front[None], through[None])[0] > 10 * overlap
    found = front
    for _ in range(20):
        ways = swept_configurations(robot, front, found)
        found = solver.solve_frame(found, targets, proximal=drawn, iterations=1, between=ways).qpos
    assert solver.depths_between(front[None], found[None])[0] <= 0.002
    assert np.abs(found - front).max() > 0.2


@pytest.mark.parametrize("fps", [15, 30])
def test_hands_that_go_to_the_hips_and_back_pass_nothing_between_frames(fps: int) -> None:
    robot, motion = load_robot("op3"), read_motion(SAMPLES / "hips_and_bow.bvh").resample(fps)
    assert deepest(robot, retarget(motion, robot, balance="off").trajectory.qpos) < 0.003


@needs_shared
def test_arms_that_swing_in_a_dance_pass_nothing_between_frames() -> None:
    robot = load_robot(SHARED / "robots/robotis_op3/robotis_op3.xml")
    motion = read_motion(SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/05_06_dance.bvh").resample(30)
    assert deepest(robot, retarget(motion, robot, balance="off").trajectory.qpos) < 0.003
