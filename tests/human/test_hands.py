"""Hands turn as the source's hands do, where a robot has the wrists for it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.segments import pointed
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.solver.pipeline import retarget

TURN = 0.5 * np.sin(np.linspace(0, 4 * np.pi, 25))
"""By which a hand turns about its forearm [rad]."""


def still(robot: Robot, turn: Floats) -> Motion:
    """A human who holds the arms as before a clap and turns the left hand about its forearm."""
    clap = read_motion(SAMPLES / "clap.bvh").resample(30)
    assert clap.rotations is not None
    frames = [40] * len(turn)
    held = replace(clap, positions=clap.positions[frames], rotations=clap.rotations[frames])
    matched = match(held, robot)
    x = matched.human_positions(held)
    along = x[:, matched.index("l_hand")] - x[:, matched.index("l_elbow")]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    hand, rotations = matched.recognition.marks["l_hand"].joints[0], np.array(held.rotations)
    turned = Rotation.from_rotvec(turn[:, None] * along) * Rotation.from_quat(rotations[:, hand], scalar_first=True)
    rotations[:, hand] = turned.as_quat(scalar_first=True)
    return replace(held, rotations=rotations)


def hinges(robot: Robot, turn: Floats) -> Floats:
    loose = Weights(smooth=1e-3, jerk=1e-3)  # a wrist follows at once
    return retarget(still(robot, turn), robot, weights=loose, balance="off").trajectory.qpos[:, robot.qpos_index]


@needs_shared
def test_a_wrist_turns_by_as_much_as_the_hand_about_its_forearm() -> None:
    robot = load_robot(str(SHARED / "robots/unitree_g1/unitree_g1.xml"))
    wrist = robot.joint_names.index("left_wrist_roll_joint")
    change = hinges(robot, TURN) - hinges(robot, 0 * TURN)
    assert np.abs(change[:, wrist] - TURN).max() < 0.1
    others = [k for k, name in enumerate(robot.joint_names) if "left_wrist" not in name]
    assert np.abs(change[:, others]).max() < 0.05


@needs_shared
@pytest.mark.parametrize(("clip", "first", "last"), [("hips_and_bow", 40, 140), ("wave", 40, 80), ("clap", 0, 60)])
def test_a_hand_points_where_its_fingers_are_whichever_part_of_a_clip_is_seen(clip: str, first: int, last: int) -> None:
    motion = read_motion(SAMPLES / f"{clip}.bvh").frames(first, last)
    matched = match(motion, load_robot(str(SHARED / "robots/unitree_g1/unitree_g1.xml")))
    frames, names = features_of(motion, matched).segments, motion.skeleton.names
    for side, wrist in (("l", "LeftWrist"), ("r", "RightWrist")):
        hand, fingers = (motion.positions[:, names.index(name)] for name in (wrist, f"{wrist}_end"))
        assert (np.einsum("ti,ti->t", frames[f"{side}_hand"][:, :, 0], unit(fingers - hand)) > np.cos(0.02)).all()


@needs_shared
@pytest.mark.parametrize("clip", ["walk", "squat", "wave", "clap", "hips_and_bow"])
def test_part_of_a_clip_tells_the_same_of_hands_as_the_whole(clip: str) -> None:
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh"), load_robot(str(SHARED / "robots/unitree_g1/unitree_g1.xml"))
    part = motion.frames(40, 100)
    whole, alone = (features_of(m, match(m, robot)).segments for m in (motion, part))
    for hand in ("l_hand", "r_hand"):
        assert np.allclose(whole[hand][40:100], alone[hand])


@needs_shared
def test_a_rest_pose_that_the_motion_contradicts_is_not_believed() -> None:
    """The axes of a wrist turned half around its fingers: the rest pose then has the palm on the other side."""
    clap, robot = read_motion(SAMPLES / "clap.bvh"), load_robot(str(SHARED / "robots/unitree_g1/unitree_g1.xml"))
    wrist, rotations = clap.skeleton.names.index("LeftWrist"), np.array(clap.rotations)
    half = Rotation.from_rotvec(np.pi * unit(clap.skeleton.outward(wrist)))
    turned = Rotation.from_quat(rotations[:, wrist], scalar_first=True) * half
    rotations[:, wrist] = turned.as_quat(scalar_first=True)
    other = replace(clap, rotations=rotations)
    assert np.allclose(
        features_of(clap, match(clap, robot)).segments["l_hand"],
        features_of(other, match(other, robot)).segments["l_hand"],
    )


@pytest.mark.parametrize("fingers", [[0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 0.1]])
def test_fingers_that_are_missing_or_far_off_the_forearm_leave_the_hand_as_it_was_fitted(fingers: list[float]) -> None:
    """Some exporters end every chain by the same offset, whichever way the limb goes."""
    fitted = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    assert np.array_equal(pointed(fitted, np.array(fingers)), fitted)


@pytest.mark.parametrize(
    ("fingers", "ahead"), [([1.0, 0.3, -0.2], [1.0, 0.0, 0.0]), ([1.0, 0.6, 0.4], unit(np.array([1.0, 0.6, 0.4])))]
)
def test_a_hand_points_to_its_fingers_or_along_the_axis_they_are_near(fingers: list[float], ahead: Floats) -> None:
    fitted = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    assert np.allclose(pointed(fitted, np.array(fingers))[:, 0], ahead)


def test_a_robot_without_wrists_heeds_no_hand() -> None:
    robot = load_robot("op3")
    assert not {"l_hand", "r_hand"} & recognise(robot).frames.keys()
    assert np.array_equal(hinges(robot, TURN), hinges(robot, 0 * TURN))
