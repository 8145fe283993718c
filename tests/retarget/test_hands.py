"""Hands turn as the source's hands do, where a robot has the wrists for it."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.arrays import Floats
from robot_retarget.motion import Motion, read_motion
from robot_retarget.retarget.clip import Smoothing
from robot_retarget.retarget.match import match
from robot_retarget.retarget.transfer import retarget
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.shipped import SAMPLES

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
    return retarget(still(robot, turn), robot, smoothing=Smoothing(passes=0)).trajectory.qpos[:, robot.qpos_index]


@needs_shared
def test_a_wrist_turns_by_as_much_as_the_hand_about_its_forearm() -> None:
    robot = load_robot(str(SHARED / "robots/unitree_g1/unitree_g1.xml"))
    wrist = robot.joint_names.index("left_wrist_roll_joint")
    change = hinges(robot, TURN) - hinges(robot, 0 * TURN)
    assert np.abs(change[:, wrist] - TURN).max() < 0.1
    others = [k for k, name in enumerate(robot.joint_names) if "left_wrist" not in name]
    assert np.abs(change[:, others]).max() < 0.05


def test_a_robot_without_wrists_heeds_no_hand() -> None:
    robot = load_robot("op3")
    assert not {"l_hand", "r_hand"} & recognise(robot).frames.keys()
    assert np.array_equal(hinges(robot, TURN), hinges(robot, 0 * TURN))
