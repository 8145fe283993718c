"""What a retargeted trajectory must be: within ranges, above the floor, itself again when there is nothing to change."""

from dataclasses import replace

import numpy as np
import pytest

from robot_retarget.motion import Motion, Skeleton, read_motion
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.frame import Options
from robot_retarget.solve.solution import Status
from robot_retarget.transfer import Result, retarget


@pytest.fixture(scope="module")
def squat() -> Result:
    return retarget(read_motion(SAMPLES / "squat.bvh").resample(15), load_robot("op3"))


def test_joint_ranges_hold_exactly(squat: Result) -> None:
    robot = load_robot("op3")
    hinges = squat.trajectory.qpos[:, robot.qpos_index]
    assert (hinges >= robot.lower - 1e-9).all() and (hinges <= robot.upper + 1e-9).all()


def test_no_sole_point_sinks_under_the_floor(squat: Result) -> None:
    robot = load_robot("op3")
    for sole in squat.match.anatomy.soles.values():
        assert world_points(robot, sole, squat.trajectory.qpos)[:, :, 2].min() > -1e-9


def test_every_frame_says_how_it_ended(squat: Result) -> None:
    solution = squat.solution
    assert len(solution.status) == len(solution.trajectory) == len(solution.stress)
    assert {type(s) for s in solution.status} == {Status}
    assert np.isfinite(solution.stress).all() and solution.timings["solve"] > 0


def test_quaternions_stay_unit(squat: Result) -> None:
    assert np.allclose(np.linalg.norm(squat.trajectory.qpos[:, 3:7], axis=1), 1.0, atol=1e-9)


def test_a_human_twice_as_tall_moves_the_same_joints() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").resample(10).frames(0, 20), load_robot("op3")
    skeleton = motion.skeleton
    tall = replace(
        motion,
        positions=2 * motion.positions,
        skeleton=Skeleton(skeleton.names, skeleton.parents, 2 * skeleton.offsets),
    )
    here, there = (retarget(m, robot).trajectory.qpos for m in (motion, tall))
    assert np.abs(here - there).max() < 1e-6


def own_motion(frames: int = 12) -> tuple[Motion, np.ndarray]:
    """The OP3's keypoints along a motion of its own, as if a human of its shape had been filmed."""
    robot = load_robot("op3")
    anatomy = recognise(robot)
    draw = np.random.default_rng(0)
    goal = np.clip(robot.standing()[robot.qpos_index] + draw.normal(scale=0.2, size=20), robot.lower, robot.upper)
    qpos = np.tile(robot.standing(), (frames, 1))
    share = np.linspace(0, 1, frames)[:, None]
    qpos[:, robot.qpos_index] += share * (goal - qpos[:, robot.qpos_index])
    qpos[:, 2] += 0.05
    x = world_points(robot, anatomy.points, qpos)
    parents = np.array([-1 if k == "pelvis" else 0 for k in anatomy.names])
    skeleton = Skeleton(anatomy.names, parents, np.zeros((len(anatomy.names), 3)))
    return Motion(skeleton, x, None, 10.0, "own"), qpos


def test_its_own_motion_comes_back_to_the_keypoints() -> None:
    from robot_retarget.describe.edges import build_edges
    from robot_retarget.describe.match import match_bodies
    from robot_retarget.motion.recognise import Mark, Recognition
    from robot_retarget.solve.clip import Smoothing
    from robot_retarget.solve.problem import build_problem
    from robot_retarget.solve.solve import solve

    robot = load_robot("op3")
    motion, _ = own_motion()
    marks = {k: Mark((j,), 1.0, "same") for j, k in enumerate(motion.skeleton.names)}
    matched = match_bodies(motion, robot, Recognition(marks), recognise(robot))
    edges = build_edges(motion, matched)
    free = Options(footholds=False, separation=False, iterations=40)  # its feet sway in the air: nothing stands
    solution = solve(
        build_problem(robot, matched, edges), edges, motion.fps, options=free, smoothing=Smoothing(passes=0)
    )
    x = world_points(robot, matched.points, solution.trajectory.qpos)
    i, j = np.triu_indices(x.shape[1], 1)
    apart = np.linalg.norm(x[:, i] - x[:, j], axis=2) - np.linalg.norm(
        motion.positions[:, i] - motion.positions[:, j], axis=2
    )
    assert np.abs(apart).max() < 0.01  # [m]


def test_one_frame_is_enough() -> None:
    result = retarget(read_motion(SAMPLES / "wave.bvh").frames(0, 1), load_robot("op3"))
    assert len(result.trajectory) == 1


def test_the_same_input_gives_the_same_output() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 5), load_robot("op3")
    first, second = (retarget(motion, robot, options=Options(starts=4)).trajectory.qpos for _ in range(2))
    assert (first == second).all()


def test_a_jump_is_told_with_its_joint_and_frame() -> None:
    from robot_retarget.summary import describe_solution

    result = retarget(read_motion(SAMPLES / "wave.bvh").resample(30).frames(0, 6), load_robot("op3"))
    assert not result.solution.jumps()
    qpos = np.array(result.trajectory.qpos)
    qpos[4:, -20 + 2] -= 0.55  # the third hinge, at 30 frames a second
    leaping = replace(result.solution, trajectory=replace(result.trajectory, qpos=qpos))
    (joint, frame, step), *others = leaping.jumps()
    assert (joint, frame, others) == ("l_sho_pitch", 4, []) and step == pytest.approx(-0.55, abs=0.05)
    assert any("l_sho_pitch jumps by" in sentence for sentence in describe_solution(leaping)["notes"])
