"""The sketch: the cheapest path through the ways is the cheapest of all, and it finds a raised arm."""

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot, world_points
from robot_retarget.robot.kinematics import carrying, difference
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing
from robot_retarget.solve.footing import held_corners
from robot_retarget.solve.frame import FrameSolver, Options, Pose
from robot_retarget.solve.pool import Pool, Sketching
from robot_retarget.solve.problem import build_problem
from robot_retarget.solve.sketch import between
from robot_retarget.solve.solution import Status
from robot_retarget.solve.starts import drawn_limbs, ways
from robot_retarget.transfer import retarget


@pytest.mark.parametrize("hurry", [0.0, 30.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_chosen_path_is_the_cheapest_of_all(seed: int, hurry: float) -> None:
    robot, draw = load_robot("op3"), np.random.default_rng(seed)
    solver, none = cast(Any, SimpleNamespace(robot=robot)), cast(Any, None)
    pool = Pool(solver, none, np.zeros(0), np.arange(5), 10.0, Sketching())
    for moment in range(5):
        for _ in range(1 + moment % 3):
            pose = robot.standing()
            pose[robot.qpos_index] += draw.normal(size=20)  # turns beyond the joints' speeds among them
            pool.poses[moment].append(Pose(pose, Status.CONVERGED, float(draw.uniform(0, 20)), 1))

    def total(path: tuple[Pose, ...]) -> float:
        turns = np.array([difference(robot, a.qpos, b.qpos) for a, b in itertools.pairwise(path)])
        beyond = np.maximum(np.abs(turns[:, robot.dof_index]) - robot.max_speed / 10, 0.0)
        change, hurried = float(np.square(turns).sum()), float(np.square(beyond).sum())
        return sum(p.cost for p in path) + pool.sketching.change * change + hurry * hurried

    chosen = total(tuple(pool.cheapest(hurry)))
    assert chosen == pytest.approx(min(total(p) for p in itertools.product(*pool.poses)))


def test_a_smooth_motion_comes_back_between_the_frames_of_the_sketch() -> None:
    robot, frames = load_robot("op3"), np.append(np.arange(0, 89, 3), 89)
    when = np.arange(90) / 30
    true = np.repeat(robot.standing()[None], 90, axis=0)
    true[:, robot.qpos_index] += 0.3 * np.sin(2 * np.pi * when[:, None] + np.arange(20))  # a step a second
    true[:, robot.qpos_index] = true[:, robot.qpos_index].clip(robot.lower, robot.upper)
    true[:, 3:7] = Rotation.from_rotvec(0.5 * np.sin(2 * np.pi * when)[:, None] * [0, 0, 1]).as_quat(scalar_first=True)
    found = between(robot, frames, list(true[frames]), [])
    missed = np.array([difference(robot, a, b) for a, b in zip(true, found, strict=True)])
    inside = ((true[:, robot.qpos_index] > robot.lower) & (true[:, robot.qpos_index] < robot.upper)).all(axis=0)
    assert inside.sum() > 5
    assert np.abs(missed[:, robot.dof_index[inside]]).max() < 5e-3 and np.abs(missed[:, :6]).max() < 5e-3
    angles = np.array(found)[:, robot.qpos_index]
    assert (angles >= robot.lower).all() and (angles <= robot.upper).all()


def hand_over_shoulder(smoothing: Smoothing | None) -> np.ndarray:
    """(T,) how high the waving hand is over its shoulder [m], where the human's is."""
    robot = load_robot("op3")
    result = retarget(read_motion(SAMPLES / "wave.bvh").resample(15), robot, smoothing=smoothing)
    x = world_points(robot, result.match.points, result.trajectory.qpos)
    human = result.match.human_positions(result.motion)
    hand, shoulder = result.match.index("r_hand"), result.match.index("r_shoulder")
    raised = human[:, hand, 2] > human[:, shoulder, 2] + 0.15
    return (x[:, hand, 2] - x[:, shoulder, 2])[raised]


def test_a_waving_hand_is_raised_by_an_arm_that_cannot_bend_forward() -> None:
    assert hand_over_shoulder(None).min() > 0.02


def pool_of(picked: np.ndarray) -> Pool:
    """The pool of a robot that follows some frames of a waving human at ten a second."""
    robot, wave = load_robot("op3"), read_motion(SAMPLES / "wave.bvh").resample(10)
    leaping = replace(wave, positions=wave.positions[picked], rotations=None)
    matched = match(leaping, robot)
    edges = build_edges(leaping, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))
    return Pool(solver, edges, held, np.arange(len(picked)), 10.0, Sketching())


def haste(pool: Pool, path: list[Pose]) -> float:
    """The fastest turn of a joint from moment to moment, over its speed."""
    robot = pool.solver.robot
    turned = np.abs(np.diff([pose.qpos[robot.qpos_index] for pose in path], axis=0))
    return float((turned / robot.max_speed).max()) * 10


HANGING, RAISED = 0, 20


def test_a_way_that_is_followed_turns_no_faster_than_the_joints() -> None:
    pool = pool_of(np.tile([HANGING, RAISED], 4))
    pool.set_out(pool.solver.robot.standing())
    way = [poses[0] for poses in pool.poses]
    assert haste(pool, way) < 1 + 1e-9


def test_a_way_that_meets_no_other_is_followed_to_both_ends() -> None:
    pool = pool_of(np.repeat([HANGING, RAISED, HANGING], 12))
    pool.seek(18)
    assert all(pool.poses)


def dearer(pool: Pool, best: Pose, end: str) -> Pose:
    """The cheapest of some ends that differ from the best pose by an arm on another way, and cost a tenth more."""
    solver, wished = pool.solver, pool._wished(0)
    limb, drawn = next((limb, drawn) for limb, drawn in drawn_limbs(solver).items() if _ends(solver, limb, end))
    columns, found = solver.robot.qpos_index[list(limb)], list[Pose]()
    for angles in drawn[:20]:
        start = best.qpos.copy()
        start[columns] = angles
        pose = solver.descend(start, wished)
        turned = np.abs(pose.qpos - best.qpos)[solver.robot.qpos_index]
        if turned[list(limb)].max() > 1.0 and np.delete(turned, limb).max() < 0.5 and pose.cost > 1.1 * best.cost:
            found.append(pose)
    return min(found, key=lambda pose: pose.cost)


def _ends(solver: FrameSolver, limb: tuple[int, ...], end: str) -> bool:
    """Whether a limb's last hinge moves a hand or the head."""
    body = solver.problem.match.anatomy.spots[end].body
    return bool(carrying(solver.robot.model)[body, solver.robot.dof_index[limb[-1]]])


def test_limbs_that_are_each_right_in_another_pose_are_found_together() -> None:
    pool = pool_of(np.array([RAISED]))
    best = ways(pool.solver, pool._wished(0), pool.edges, 0)[0]
    left, right = (dearer(pool, best, end) for end in ("l_hand", "r_hand"))
    pool.poses[0] = [left, right]
    assert pool.mix([max(left, right, key=lambda pose: pose.cost)], stride=1)
    assert min(pose.cost for pose in pool.poses[0]) < 1.03 * best.cost


def test_ways_are_sought_where_a_path_is_caught_between_the_moments_at_which_they_were() -> None:
    costs = [4.0, 5.0, 9.0, 8.0, 4.0, 5.0, 5.9, 4.0, 20.0, 25.0]  # sought at 0, 4 and 8
    path = [Pose(np.zeros(0), Status.CONVERGED, cost, 1) for cost in costs]
    robot, none = cast(Any, SimpleNamespace(robot=load_robot("op3"))), cast(Any, None)
    pool = Pool(robot, none, np.zeros(0), np.arange(10), 10.0, Sketching())
    assert pool.dearest(path, stride=4) == [2]
    pool.first = 3  # what is known is not in question
    assert pool.dearest(path, stride=4) == []


def test_where_the_cheapest_path_leaps_the_sketch_goes_across_as_fast_as_joints_may() -> None:
    pool = pool_of(np.repeat([HANGING, RAISED], 6))
    for moment in (0, 11):
        pool.seek(moment)
    leaping = pool.cheapest(hurry=0.0)
    pool.cross(leaping)
    crossing = pool.cheapest(pool.sketching.hurry)
    assert haste(pool, leaping) > 1.5 and haste(pool, crossing) < 1.1
    assert crossing[0] is leaping[0] and crossing[-1] is leaping[-1]
