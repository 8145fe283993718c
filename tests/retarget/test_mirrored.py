"""A mirrored motion gives the mirrored trajectory: no side is preferred, not even by the draws."""

from dataclasses import replace

import numpy as np
import pytest

from robot_retarget.motion import Motion, read_motion
from robot_retarget.retarget.clip import Smoothing
from robot_retarget.retarget.frame import Options
from robot_retarget.retarget.transfer import retarget
from robot_retarget.robot import load_robot
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.shipped import SAMPLES

LEFT = np.array([0.0, 1.0, 0.0])


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged: joints, places and turns."""
    names = motion.skeleton.names
    other = [n.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for n in names]
    order = [names.index(n) for n in other]
    turned = None if motion.rotations is None else motion.rotations[:, order] * [1, -1, 1, -1]
    return replace(motion, positions=motion.positions[:, order] * [1, -1, 1], rotations=turned)


CAUSAL, WHOLE = Smoothing(passes=0), Smoothing()
CLOSE, FREE = Options(), Options(separation=False)
CASES = [
    ("wave", CAUSAL, CLOSE),
    ("walk", CAUSAL, CLOSE),
    ("wave", WHOLE, CLOSE),
    ("walk", WHOLE, CLOSE),
    # Its own mirror image: where knees touch, either side may come first.
    ("squat", WHOLE, FREE),
]


@pytest.mark.parametrize(("clip", "smoothing", "options"), CASES)
def test_a_mirrored_motion_gives_the_mirrored_trajectory(clip: str, smoothing: Smoothing, options: Options) -> None:
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(15), load_robot("op3")
    motions = (motion, mirrored(motion))
    here, there = (retarget(m, robot, smoothing=smoothing, options=options).trajectory for m in motions)
    hinges, sides = robot.qpos_index, mirror_of(robot, LEFT)
    assert np.abs(sides.angles(here.qpos[:, hinges]) - there.qpos[:, hinges]).max() < 1e-3
