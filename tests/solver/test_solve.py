"""What a retargeted trajectory must be: within ranges, above the floor, itself again when there is nothing to change."""

from dataclasses import replace

import numpy as np
import pytest

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import RobotGraph, graph_of
from robot_retarget.graph.track import Status, frame_costs
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match_bodies
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.recognition.recognise import Mark, Recognition
from robot_retarget.human.skeleton import Skeleton
from robot_retarget.robot import load_robot, recognise, world_points
from robot_retarget.solver.options import Search
from robot_retarget.solver.pipeline import Result, retarget
from robot_retarget.solver.problem import build_problem
from robot_retarget.solver.solve import solve_graph
from robot_retarget.tools.summary import describe_solution


@pytest.fixture(scope="module")
def squat() -> Result:
    return retarget(read_motion(SAMPLES / "squat.bvh").resample(15), load_robot("op3"), balance="off")


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
    assert len(solution.status) == len(solution.trajectory) == len(solution.cost)
    assert {type(s) for s in solution.status} == {Status}
    assert np.isfinite(solution.cost).all() and solution.timings["solve"] > 0


def test_quaternions_stay_unit(squat: Result) -> None:
    assert np.allclose(np.linalg.norm(squat.trajectory.qpos[:, 3:7], axis=1), 1.0, atol=1e-9)


def test_a_human_twice_as_tall_moves_the_same_joints() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").resample(10), load_robot("op3")
    skeleton = motion.skeleton
    tall = replace(
        motion,
        positions=2 * motion.positions,
        skeleton=Skeleton(skeleton.names, skeleton.parents, 2 * skeleton.offsets),
    )
    here, there = (retarget(m.frames(0, 20), robot, balance="off").trajectory.qpos for m in (motion, tall))
    assert np.abs(here - there).max() < 1e-6


def own_motion(frames: int = 40) -> tuple[RobotGraph, np.ndarray]:
    """The OP3's keypoints along a motion of its own, as if a human of its shape had been filmed: (T, nq) and their graph."""
    robot = load_robot("op3")
    anatomy, draw = recognise(robot), np.random.default_rng(0)
    goal = np.clip(robot.standing()[robot.qpos_index] + draw.normal(scale=0.3, size=20), robot.lower, robot.upper)
    qpos = np.tile(robot.standing(), (frames, 1))
    share = np.sin(np.linspace(0, np.pi / 2, frames))[:, None] ** 2
    qpos[:, robot.qpos_index] += share * (goal - qpos[:, robot.qpos_index])
    qpos[:, 2] += 0.05
    x = world_points(robot, anatomy.points, qpos)
    left, right = (anatomy.names.index(f"{side}_hip") for side in "lr")
    x[:, anatomy.names.index("pelvis")] = (x[:, left] + x[:, right]) / 2
    parents = np.array([-1 if k == "pelvis" else 0 for k in anatomy.names])
    skeleton = Skeleton(anatomy.names, parents, np.zeros((len(anatomy.names), 3)))
    motion = Motion(skeleton, x, None, 30.0, "own")
    marks = {k: Mark((j,), 1.0, "same") for j, k in enumerate(skeleton.names)}
    matched = match_bodies(motion, robot, Recognition(marks), anatomy)
    return graph_of(motion, features_of(motion, matched), robot, Weights()), qpos


def test_its_own_motion_comes_back() -> None:
    """Of its own distances, directions and path alone; its feet sway in the air, so that nothing stands."""
    graph, qpos = own_motion()
    for kind in ("foothold", "orientation", "rest"):
        graph = graph.without(kind)
    problem, costs, first = build_problem(graph.robot, graph.match, graph.tracks), frame_costs(graph.tracks), 0
    measured = np.array([problem.values(q) for q in qpos])
    tracks = [track for track in graph.tracks if all(track is not cost for cost in costs)]
    for track in costs:
        own = measured[:, first : first + len(track)]
        tracks, first = [*tracks, replace(track, lower=own, upper=own)], first + len(track)
    solution = solve_graph(replace(graph, tracks=tuple(tracks)))
    hinges = graph.robot.qpos_index
    assert np.ptp(qpos[:, hinges], axis=0).max() > 0.5
    assert np.abs(solution.trajectory.qpos[:, hinges] - qpos[:, hinges]).max() < 0.01


def test_one_frame_is_enough() -> None:
    result = retarget(read_motion(SAMPLES / "wave.bvh").frames(0, 1), load_robot("op3"), balance="off")
    assert len(result.trajectory) == 1


def test_the_same_input_gives_the_same_output() -> None:
    motion, robot = read_motion(SAMPLES / "wave.bvh").frames(0, 5), load_robot("op3")
    first, second = (retarget(motion, robot, search=Search(starts=4), balance="off").trajectory.qpos for _ in range(2))
    assert (first == second).all()


def test_a_jump_is_told_with_its_joint_and_frame() -> None:
    result = retarget(read_motion(SAMPLES / "wave.bvh").resample(30).frames(0, 6), load_robot("op3"), balance="off")
    assert not result.solution.jumps()
    qpos = np.array(result.trajectory.qpos)
    qpos[4:, -20 + 2] -= 0.55  # the third hinge, at 30 frames a second
    leaping = replace(result.solution, trajectory=replace(result.trajectory, qpos=qpos))
    (joint, frame, step), *others = leaping.jumps()
    assert (joint, frame, others) == ("l_sho_pitch", 4, []) and step == pytest.approx(-0.55, abs=0.05)
    assert any("l_sho_pitch jumps by" in sentence for sentence in describe_solution(leaping)["notes"])
