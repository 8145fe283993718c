"""A robot's own motion, read as a source, comes back to the angles that made it: no wish pulls elsewhere."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import Match, match
from robot_retarget.keypoints import parents_within
from robot_retarget.motion import Motion, Skeleton, read_motion
from robot_retarget.robot import Robot, load_robot, recognise, world_points
from robot_retarget.robot.kinematics import body_frames
from robot_retarget.shipped import SAMPLES
from robot_retarget.solve.clip import Smoothing, doubts
from robot_retarget.solve.footing import held_corners
from robot_retarget.solve.frame import FrameSolver, Options
from robot_retarget.solve.problem import build_problem
from robot_retarget.solve.sketch import settled, sketch
from robot_retarget.transfer import retarget

FPS = 30.0
OP3 = load_robot("op3")
CAUSAL, WHOLE = Smoothing(passes=0), Smoothing()
UNSEEN = {"head_pan", "l_ank_roll", "r_ank_roll"}
"""What no joint centre of the OP3 shows: turns about the line to a head, and about the line to a toe."""


BOTH = pytest.mark.parametrize("smoothing", [CAUSAL, WHOLE], ids=["frame by frame", "whole"])


@cache
def played(clip: str) -> Floats:
    """The OP3's configurations for a sample clip, three seconds of it (T, nq)."""
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS)
    return retarget(motion.frames(0, 90), OP3).trajectory.qpos


def swung(hertz: float) -> Floats:
    """Four seconds of the OP3 swinging arms and head by a formula, limbs clear of each other, and bending its knees (T, nq)."""
    robot, turns = OP3, 2 * np.pi * hertz * np.arange(120) / FPS
    qpos = np.tile(robot.standing(), (len(turns), 1))
    bend = 0.5 + 0.15 * np.cos(turns / 2)
    for side, sign in (("l", 1), ("r", -1)):
        hip, knee, ankle, *arm = (
            robot.qpos_index[robot.joint_names.index(f"{side}_{name}")]
            for name in ("hip_pitch", "knee", "ank_pitch", "sho_pitch", "sho_roll", "el")
        )
        qpos[:, [hip, knee, ankle]] = sign * bend[:, None] * [-1.0, 2.0, 1.0]
        swing = [0.3 * np.sin(turns + sign), 0.15 * np.sin(0.7 * turns + sign), 0.3 * np.sin(0.8 * turns + sign)]
        qpos[:, arm] += np.stack(swing, axis=1) - sign * np.array([0.0, 0.4, 0.4])
    head = [robot.qpos_index[robot.joint_names.index(name)] for name in ("head_pan", "head_tilt")]
    qpos[:, head] += np.stack([0.3 * np.sin(0.6 * turns), 0.2 * np.sin(0.9 * turns)], axis=1)
    soles = [world_points(robot, soles, qpos)[..., 2] for soles in recognise(robot).soles.values()]
    qpos[:, 2] -= np.concatenate(soles, axis=1).min(axis=1)
    return qpos


def as_source(qpos: Floats, rotations: bool, robot: Robot = OP3) -> Motion:
    """What a motion capture of the robot's own keypoints would record, by MuJoCo's kinematics."""
    anatomy = recognise(robot)
    tree = parents_within(anatomy.names)
    parents = np.array([anatomy.names.index(tree[k]) if k in tree else -1 for k in anatomy.names])
    turns = body_frames(robot, qpos)[1][:, anatomy.points.bodies]
    wxyz = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*turns.shape[:2], 4)
    skeleton = Skeleton(anatomy.names, parents, np.zeros((len(parents), 3)))
    return Motion(skeleton, world_points(robot, anatomy.points, qpos), wxyz if rotations else None, FPS, "itself")


def missed(qpos: Floats, rotations: bool, smoothing: Smoothing, robot: Robot = OP3) -> Floats:
    """(T, n) by how much every hinge comes back elsewhere [rad]."""
    back = retarget(as_source(qpos, rotations, robot), robot, smoothing=smoothing).trajectory.qpos
    return np.abs(back - qpos)[:, robot.qpos_index]


def at_rest(matched: Match) -> Floats:
    """(K − 1,) the robot's bones in its reference pose, all but the root's [m]."""
    return np.linalg.norm(matched.rest - matched.rest[matched.parents], axis=1)[1:]


@BOTH
@pytest.mark.parametrize("clip", ["walk", "wave", "clap", "squat", "hips_and_bow"])
def test_with_rotations_every_joint_comes_back_within_a_hundredth(clip: str, smoothing: Smoothing) -> None:
    assert missed(played(clip), True, smoothing).max() < 0.01


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_robot_is_known_by_its_bones_and_they_are_as_long_as_it_shows(scale: float) -> None:
    """The clap's shoulders are a fiftieth further from the neck than those of the reference pose."""
    source, robot = as_source(played("clap"), True), OP3
    matched = match(replace(source, positions=scale * source.positions), robot)
    off = dict(zip(matched.keypoints[1:], matched.robot_bones[1:] / at_rest(matched) - 1, strict=True))
    assert matched.itself
    assert np.allclose(matched.robot_bones * scale, matched.human_bones, rtol=1e-6)
    assert 0.01 < off["l_shoulder"] < 0.03 and abs(off["l_knee"]) < 1e-6


@needs_shared
@BOTH
def test_a_hinge_that_turns_in_full_is_not_stopped_at_its_bound(smoothing: Smoothing) -> None:
    """This model gives every hinge the whole turn, and its arms hang near the bound of two of them."""
    robot = load_robot(SHARED / "robots/robotis_op3/robotis_op3.xml")
    clap = read_motion(SAMPLES / "clap.bvh").resample(FPS).frames(0, 60)
    assert missed(retarget(clap, robot).trajectory.qpos, True, smoothing, robot).max() < 0.01


@needs_shared
@BOTH
@pytest.mark.parametrize(
    ("name", "clip"),
    [
        ("booster_t1", "walk"),  # steps: a foot that turns slowly where a human's would be taken to stand
        (
            "booster_t1",
            "squat",
        ),  # what a capture takes for the pelvis, the middle of the hips, is two centimetres off it
        ("toddlerbot_2xc", "walk"),
        ("toddlerbot_2xc", "squat"),
        ("toddlerbot_2xc", "clap"),
        ("unitree_g1", "walk"),
        ("unitree_g1", "hips_and_bow"),  # hands that are bent and turned in throughout
        ("unitree_h1", "walk"),  # feet that do not roll, and lie on an edge; elbows that bend both ways
        ("unitree_h1", "clap"),
    ],
)
def test_robots_of_other_builds_come_back_too(name: str, clip: str, smoothing: Smoothing) -> None:
    robot = load_robot(SHARED / f"robots/{name}/{name}.xml")
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS).frames(0, 60)
    assert missed(retarget(motion, robot).trajectory.qpos, True, smoothing, robot).max() < 0.01


@needs_shared
def test_the_way_that_meets_a_motion_is_found_among_those_that_nearly_do() -> None:
    """With hands on hips another way of these arms, most of a turn away, costs a twentieth of what a human's motion does."""
    robot = load_robot(SHARED / "robots/toddlerbot_2xc/toddlerbot_2xc.xml")
    motion = read_motion(SAMPLES / "hips_and_bow.bvh").resample(FPS).frames(0, 90)
    begun = retarget(motion, robot).trajectory.qpos[:10]
    assert missed(begun, True, CAUSAL, robot).max() < 0.01


@pytest.mark.parametrize("clip", ["walk", "wave", "clap", "squat", "hips_and_bow"])
def test_no_human_is_taken_for_a_robot(clip: str) -> None:
    matched = match(read_motion(SAMPLES / f"{clip}.bvh"), OP3)
    assert not matched.itself and np.allclose(matched.robot_bones[1:], at_rest(matched))


@BOTH
@pytest.mark.parametrize("hertz", [0.5, 1.0, 1.5])
def test_what_swings_by_a_formula_comes_back_within_a_thousandth(hertz: float, smoothing: Smoothing) -> None:
    assert missed(swung(hertz), True, smoothing).max() < 0.001


def test_noise_on_a_motion_of_its_own_is_smoothed() -> None:
    """A millimetre on every keypoint: the solver that cannot smooth is twice as far off, and jerks ten times as much."""
    robot, true = OP3, swung(0.7)
    clean = as_source(true, True)
    noise = 0.001 * np.random.default_rng(0).normal(size=clean.positions.shape)
    noisy = replace(clean, positions=clean.positions + noise)
    off, jerk = [], []
    for smoothing in (WHOLE, CAUSAL):
        back = retarget(noisy, robot, smoothing=smoothing).trajectory.qpos[:, robot.qpos_index]
        off.append(np.sqrt(np.square(back - true[:, robot.qpos_index]).mean()))
        jerk.append(np.sqrt(np.square(np.diff(back, 3, axis=0)).mean()))
    assert off[0] < 0.6 * off[1] and jerk[0] < 0.1 * jerk[1]


@pytest.mark.parametrize("clip", ["walk", "wave", "clap", "squat", "hips_and_bow"])
def test_what_a_human_does_is_smoothed_in_full(clip: str) -> None:
    """No other body moves as this robot could to the millimetre."""
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(FPS).frames(0, 90), OP3
    matched = match(motion, robot)
    edges = build_edges(motion, matched)
    solver = FrameSolver(build_problem(robot, matched, edges), Options())
    held = held_corners(edges.stances, solver.problem.feet, len(edges))
    assert doubts(settled(solver, edges, held, sketch(solver, edges, held, FPS)).cost, WHOLE.met).min() > 0.995


@BOTH
def test_without_rotations_those_come_back_that_positions_show(smoothing: Smoothing) -> None:
    shown = [name not in UNSEEN for name in OP3.joint_names]
    worst = missed(played("walk"), False, smoothing)[:, shown].max(axis=1)
    assert np.median(worst) < 0.01
    assert worst.max() < 0.03  # while a foot swings, its roll is guessed, and its leg gives way a little
