"""Links do not pass through each other between frames either."""

from itertools import pairwise

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.arrays import Floats
from robot_retarget.balance.planting import Planter
from robot_retarget.balance.stand import balanced_stand, stand_places
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.kinematics import difference, integrate
from robot_retarget.robot.separation import Separation
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.between import TURN, Between, on_the_way
from robot_retarget.solve.footing import HOLD
from robot_retarget.solve.frame import OVERLAP, FrameSolver, Options, Pose
from robot_retarget.solve.mending import Mender, Passages
from robot_retarget.solve.problem import build_problem, frame_parameters
from robot_retarget.solve.quadratic import Pull
from robot_retarget.solve.solution import Status
from robot_retarget.transfer import retarget

Asked = tuple[FrameSolver, tuple[Floats, ...]]


@pytest.fixture(scope="module")
def asked() -> Asked:
    motion, robot = read_motion(SAMPLES / "clap.bvh").resample(10).frames(0, 3), load_robot("op3")
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    return solver, (*frame_parameters(edges, 0), *solver.grip.lay_down(np.zeros((2, 4), dtype=bool)))


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
        looks = [before, *(way.at(robot, after) for way in on_the_way(robot, before, after)), after]
        turned = np.abs(np.diff([q[robot.qpos_index] for q in looks], axis=0)).max(axis=1)
        assert len(looks) > 2 and turned.max() <= TURN and np.allclose(turned, turned[0])


def test_rows_between_frames_tell_what_a_step_of_the_frame_does_there(asked: Asked) -> None:
    solver, wished = asked
    robot, soles, step = solver.robot, solver.problem.soles, 1e-6
    separation, way = solver.landscape.separation, Between(arms(robot, -0.5, 1.57, -1.57), 0.3)
    assert separation is not None
    q = arms(robot, -0.3, 1.57, -1.5)
    own = {tuple(row) for row in solver.landscape.around(q, wished).rows[soles:]}
    rows = [row for row in solver.landscape.around(q, wished, (way,)).rows[soles:] if tuple(row) not in own]
    for joint in ("l_sho_pitch", "l_sho_roll", "l_el"):
        direction = np.zeros(robot.model.nv)
        direction[column := robot.dof_index[robot.joint_names.index(joint)]] = step
        places = [way.at(robot, integrate(robot, q, sign * direction)) for sign in (1, -1)]
        ahead, behind = (separation.near(place)[0] for place in places)
        told, shown = np.array([row[column] for row in rows]), (ahead - behind) / (2 * step)
        told = told[np.abs(told) > 1e-6]  # of the arm, as far as there are rows for all that is near
        assert len(told) > 3 and np.abs(told[:, None] - shown).min(axis=1).max() < 1e-4


def test_links_that_are_drawn_right_through_each_other_are_given_up_and_those_that_part_are_not(asked: Asked) -> None:
    robot, passages = asked[0].robot, Passages(asked[0])
    front, back = arms(robot, -0.8, 1.57, -1.2), arms(robot, 0.9, 1.57, -1.2)
    side = arms(robot, 0.0, 0.6, 0.0)
    there, beside, through = (Pose(q, Status.CONVERGED, 0.0, 1) for q in (front, side, back))
    deep = asked[0].depth_between(front, back)
    assert deep > 10 * OVERLAP and not asked[0].overlapping(front) and not asked[0].overlapping(back)
    assert passages.look([there, through, there], [0, 1]) == {0, 1} == passages.met
    assert len(passages.between([there, through, there], 1)) == 2 * len(on_the_way(robot, front, back))
    assert passages.look([there, through, beside], [0, 1]) == set()
    assert passages.lost == {0} and passages.met == {1}
    assert passages.between([there, through, beside], 0) == ()


def test_frames_that_made_way_in_vain_come_back_to_what_is_asked_of_them(asked: Asked) -> None:
    solver, wished = asked
    front, back = (arms(solver.robot, pitch, 1.57, -1.2) for pitch in (-0.8, 0.9))
    poses = [Pose(q, Status.CONVERGED, np.inf, 1) for q in (front, back, front)]
    free = Pull(front, np.zeros(solver.robot.model.nv), np.zeros(solver.robot.model.nv))
    passages = Passages(solver)
    assert passages.look(poses, [0, 1]) == {0, 1}
    mended = Mender(solver, [wished] * 3, [free] * 3, passages, fixed=0, fps=0.1).mended(poses)
    assert passages.lost == {0, 1}
    for before, after in zip(poses, mended, strict=True):
        cost = [solver.landscape.around(pose.qpos, wished).cost for pose in (before, after)]
        assert cost[1] < 0.5 * cost[0]


@pytest.mark.parametrize("fps", [15, 30])
def test_hands_that_go_to_the_hips_and_back_pass_nothing_between_frames(fps: int) -> None:
    robot, motion = load_robot("op3"), read_motion(SAMPLES / "hips_and_bow.bvh").resample(fps)
    assert deepest(robot, retarget(motion, robot).trajectory.qpos) < 0.003


@needs_shared
def test_arms_that_swing_in_a_dance_pass_nothing_between_frames() -> None:
    robot = load_robot(SHARED / "robots/robotis_op3/robotis_op3.xml")
    motion = read_motion(SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/05_06_dance.bvh").resample(30)
    assert deepest(robot, retarget(motion, robot).trajectory.qpos) < 0.003


def test_a_planted_pose_is_not_reached_through_links_where_it_can_be_reached_around_them() -> None:
    robot, motion = load_robot("op3"), read_motion(SAMPLES / "walk.bvh").frames(0, 2)
    planter = Planter(robot, match(motion, robot))
    places = stand_places(planter)
    stand, middle, grip = balanced_stand(planter, places), places.mean(axis=(0, 1))[:2], np.full(2, HOLD)
    moved = [name.endswith(("sho_pitch", "sho_roll", "el")) for name in robot.joint_names]
    index, lower, upper = robot.qpos_index[moved], robot.lower[moved], robot.upper[moved]
    draw, depths = np.random.default_rng(0), []
    for _ in range(100):
        wished = stand.copy()
        wished[index] = draw.uniform(lower, upper)
        before = planter.plant(stand, wished, places, middle, grip, steps=30)
        wished = before.copy()
        wished[index] = (before[index] + draw.normal(size=len(index))).clip(lower, upper)
        found, around = (planter.plant(wished, wished, places, middle, grip, 30, before=b) for b in (None, before))
        plain, kept = (planter.solver.depth_between(before, q) for q in (found, around))
        assert planter.solver.overlapping(found) or not planter.solver.overlapping(around)
        if plain > OVERLAP:
            depths.append((plain, kept))
        else:
            assert np.allclose(found, around)
    assert len(depths) > 2 and any(kept <= OVERLAP for _, kept in depths)
