"""Likeness of motions whose differences from the human are known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.arrays import bearing
from robot_retarget.contact.touch import lasting
from robot_retarget.graph.placed_scene import pelvis_path
from robot_retarget.judge.verdict import Thresholds
from robot_retarget.scores.likeness import human_travel, likeness_of, unlikeness
from robot_retarget.scores.pair import best_bone_angles


@pytest.fixture(scope="module")
def walk() -> rr.RobotGraph:
    return rr.describe(rr.read_motion(ROOT / "samples/walk.bvh"), rr.load_robot("op3"))


@pytest.fixture(scope="module")
def turning_walk() -> rr.RobotGraph:
    """A human who walks a little way, and turns round."""
    return rr.describe(rr.read_motion(SHARED / "motions/bvh/mixamo/test_freebvh_walk.bvh"), rr.load_robot("op3"))


def placed(graph: rr.RobotGraph, share: float) -> np.ndarray:
    """(T, nq) a stiff robot that is pushed along a share of the human's path."""
    qpos = np.tile(graph.robot.standing(), (len(graph), 1))
    root = graph.robot.root_address
    qpos[:, root : root + 2] = share * pelvis_path(graph.human, graph.match)[:, :2]
    return qpos


def turned(graph: rr.RobotGraph, share: float) -> np.ndarray:
    """(T, nq) a stiff robot that turns by a share of the human's heading."""
    heading = human_travel(graph.human).heading
    qpos, root = placed(graph, 1.0), graph.robot.root_address + 3
    spin = Rotation.from_euler("z", share * heading[:, None])
    qpos[:, root : root + 4] = (spin * Rotation.from_quat(qpos[:, root : root + 4], scalar_first=True)).as_quat(
        scalar_first=True
    )
    return qpos


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0, -1.0])
def test_the_path_is_off_by_the_share_that_is_left_out(walk: rr.RobotGraph, share: float) -> None:
    assert likeness_of(walk.human, walk.robot, placed(walk, share)).path_off == pytest.approx(abs(1 - share), abs=1e-9)


@needs_shared
@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_the_heading_is_off_by_the_share_of_the_turn_that_is_left_out(
    turning_walk: rr.RobotGraph, share: float
) -> None:
    turn = human_travel(turning_walk.human).heading
    found = likeness_of(turning_walk.human, turning_walk.robot, turned(turning_walk, share))
    assert found.heading_off == pytest.approx((1 - share) * np.quantile(np.abs(turn), 0.9), abs=0.01)


@needs_shared
def test_graph_balance_and_likeness_see_one_heading_across_the_hips() -> None:
    dance = rr.read_motion(SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/05_06_dance.bvh").frames(0, 300)
    human = rr.describe(dance.resample(15), rr.load_robot("op3")).human
    match = human.calibration.match
    left = human.positions[:, match.index("l_hip"), :2] - human.positions[:, match.index("r_hip"), :2]
    np.testing.assert_allclose(human.heading, np.stack([left[:, 1], -left[:, 0]], 1) / np.hypot(*left.T)[:, None])
    turned = np.unwrap(bearing(human.heading))
    np.testing.assert_allclose(human_travel(human).heading, turned - turned[0], atol=1e-9)


def test_steps_of_a_walk_are_counted_on_both_bodies(walk: rr.RobotGraph) -> None:
    human = human_travel(walk.human)
    assert len(human.steps) == 8  # as the clip was made
    followed = rr.solve(walk, balance="off")
    assert likeness_of(walk.human, walk.robot, followed.trajectory.qpos).steps_lost == pytest.approx(
        0.0, abs=0.13
    )  # one of eight


@needs_shared
def test_a_robot_that_stands_in_place_while_the_human_walks_and_turns_is_unlike(turning_walk: rr.RobotGraph) -> None:
    stands = likeness_of(turning_walk.human, turning_walk.robot, placed(turning_walk, 0.0), legs="instead")
    sentences = unlikeness(stands.figures(), Thresholds())
    assert "stands in place: the human moves 0.9 m and turns 184° in 2 steps" in sentences


def test_frames_far_from_the_human_are_counted_and_noted_with_their_time(walk: rr.RobotGraph) -> None:
    followed = np.array(rr.solve(walk, balance="off").trajectory.qpos)
    near = likeness_of(walk.human, walk.robot, followed)
    assert near.figures()["limbs_far_share"] == 0.0 and not any("limbs" in note for note in near.notes)
    followed[20:29, walk.robot.qpos_index] = walk.robot.upper  # nine frames of another pose
    far = likeness_of(walk.human, walk.robot, followed)
    assert far.figures()["limbs_far_share"] == pytest.approx(9 / len(walk), abs=1e-4)
    start, stop = 20 / walk.fps, 29 / walk.fps
    assert f"In 9 of {len(walk)} frames, longest from {start:.1f} to {stop:.1f} s, the limbs" in far.notes[0]
    assert any("over 25°" in sentence for sentence in unlikeness(far.figures(), Thresholds(limbs_far=0.01)))


@pytest.mark.parametrize(("share", "limited"), [(0.9, False), (1.0, True)])
def test_joints_at_their_speed_limit_are_noted(walk: rr.RobotGraph, share: float, limited: bool) -> None:
    qpos, robot = placed(walk, 1.0), walk.robot
    knee, turn = robot.joint_names.index("l_knee"), share * robot.max_speed / walk.fps
    qpos[10:, robot.qpos_index[knee]] += turn[knee]
    found = likeness_of(walk.human, walk.robot, qpos)
    assert found.figures()["at_speed_limit_share"] == pytest.approx(limited / len(walk), abs=1e-4)
    assert any("a joint is at its speed limit" in note for note in found.notes) == limited


def test_feet_kept_in_place_by_choice_are_not_compared(walk: rr.RobotGraph) -> None:
    figures = likeness_of(walk.human, walk.robot, placed(walk, 0.0), legs="stand").figures()
    judged = ("path_off", "heading_off_rad", "steps_lost", "steps_shortened", "limb_rad_legs")
    assert all(figures[name] is None for name in judged)
    assert figures["human_steps"] == 8  # still reported


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"stride": 0.3}, "steps shorter than the human's, scaled, by: 70 %, more than 60 %"),
        ({"unfinished": 0.4}, "frames that the solver did not finish: 40 %, more than 25 %"),
        ({"slowdown": 3.0}, "it takes 3.0 times as long as the human"),
    ],
)
def test_each_bound_has_a_sentence(walk: rr.RobotGraph, given: dict[str, Any], told: str) -> None:
    found, near = (likeness_of(walk.human, walk.robot, placed(walk, 1.0), **options) for options in (given, {}))
    stepping = replace(found, robot=replace(found.robot, steps=found.human.steps))
    assert told in unlikeness(stepping.figures(), Thresholds())
    assert told not in unlikeness(near.figures(), Thresholds())


def test_a_robot_that_takes_no_step_has_no_length_of_steps(walk: rr.RobotGraph) -> None:
    figures = likeness_of(walk.human, walk.robot, placed(walk, 0.0)).figures()
    assert figures["robot_steps"] == 0 and figures["human_steps"] == 8
    assert figures["stride"] is None and figures["steps_shortened"] is None and figures["steps_lost"] == 1.0


@pytest.mark.parametrize("clip", ["wave", "walk"])
def test_ranges_of_joints_allow_no_nearer_pose_than_the_bound(clip: str) -> None:
    """Independent: SciPy's trust region over joints and the turn of the root, from the bound's own starts, finds no lower sum."""
    graph = rr.describe(rr.read_motion(ROOT / f"samples/{clip}.bvh"), rr.load_robot("op3")).at(slice(40, 41))
    robot, stand = graph.robot, graph.robot.standing()
    best = sum(angle[0] for angle in likeness_of(graph.human, graph.robot, stand[None]).best.values())

    def angles(values: np.ndarray) -> np.ndarray:
        qpos = stand.copy()
        qpos[3:7] = Rotation.from_rotvec(values[:3]).as_quat(scalar_first=True)
        qpos[robot.qpos_index] = values[3:]
        return np.array([angle[0] for angle in likeness_of(graph.human, graph.robot, qpos[None]).angles.values()])

    low, high = np.r_[-3.0, -3.0, -3.0, robot.lower], np.r_[3.0, 3.0, 3.0, robot.upper]
    start = np.clip(np.r_[0.0, 0.0, 0.0, stand[robot.qpos_index]], low + 1e-3, high - 1e-3)
    found = least_squares(lambda v: np.sqrt(angles(v) + 1e-4), start, bounds=(low, high), max_nfev=15)
    assert best <= angles(found.x).sum() + 0.02
    assert best <= angles(start).sum()


def test_a_hand_that_passes_a_part_makes_no_contact() -> None:
    flags = np.zeros((30, 2), bool)
    flags[3:8, 0], flags[3:9, 1] = True, True
    kept = lasting(flags, 6)
    assert not kept[:, 0].any() and kept[:, 1].sum() == 6


@pytest.mark.parametrize(("sample", "told"), [("wave", ""), ("walk", ""), ("squat", "")])
def test_samples_that_stand_on_their_feet_are_playable_standing(sample: str, told: str) -> None:
    graph = rr.describe(rr.read_motion(ROOT / f"samples/{sample}.bvh"), rr.load_robot("op3"))
    assert graph.human.not_standing == told


@pytest.mark.parametrize(("turns", "spins"), [(0.45, False), (0.55, True)])
def test_more_than_half_a_turn_on_one_foothold_is_a_spin(turns: float, spins: bool) -> None:
    motion = rr.read_motion(ROOT / "samples/wave.bvh")
    yaw = Rotation.from_rotvec(np.outer(np.linspace(0, turns * 2 * np.pi, len(motion)), [0, 0, 1])).as_matrix()
    spun = replace(motion, positions=np.einsum("tij,tkj->tki", yaw, motion.positions), rotations=None)
    human = rr.describe(spun, rr.load_robot("op3")).human
    still = replace(human, contacts=replace(human.contacts, stands=np.ones_like(human.contacts.stands)))
    assert ("spins" in still.not_standing) == spins


def test_speed_is_the_length_of_steps_over_slowdown(walk: rr.RobotGraph) -> None:
    found = likeness_of(walk.human, walk.robot, placed(walk, 1.0), slowdown=2.0, stride=0.8)
    assert replace(found, robot=replace(found.robot, steps=found.human.steps)).pace == pytest.approx(0.4)
    assert replace(found, robot=replace(found.robot, steps=())).pace is None


def test_the_bound_keeps_hinges_within_the_ranges() -> None:
    """Hinges that turn by ±0.01 rad gain little over frozen ones; free ones gain much."""
    graph = rr.describe(rr.read_motion(ROOT / "samples/walk.bvh"), rr.load_robot("op3")).at(slice(60, 61))
    robot, stand = graph.robot, graph.robot.standing()

    def bound(width: float) -> float:
        hinges = stand[robot.qpos_index]
        low, high = np.maximum(hinges - width, robot.lower), np.minimum(hinges + width, robot.upper)
        body = replace(robot, lower=low, upper=high)
        angles = best_bone_angles(body, graph.match, graph.human.positions, stand[None], graph.fps)
        return float(sum(angle[0] for angle in angles.values()))

    frozen = bound(0.0)
    assert (
        frozen <= sum(angle[0] for angle in likeness_of(graph.human, graph.robot, stand[None]).angles.values()) + 1e-6
    )
    assert frozen - 0.3 < bound(0.01) < frozen and bound(9.0) < frozen - 0.3
