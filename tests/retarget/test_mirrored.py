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
FREE = Options(separation=False)
"""MuJoCo's distance between two boxes is not that of their mirror images; without it the rest must be exact."""


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged: joints, places and turns."""
    names = motion.skeleton.names
    other = [n.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for n in names]
    order = [names.index(n) for n in other]
    turned = None if motion.rotations is None else motion.rotations[:, order] * [1, -1, 1, -1]
    return replace(motion, positions=motion.positions[:, order] * [1, -1, 1], rotations=turned)


CAUSAL, WHOLE = Smoothing(passes=0), Smoothing()


@pytest.mark.parametrize(("clip", "smoothing"), [("wave", CAUSAL), ("walk", CAUSAL), ("wave", WHOLE), ("squat", WHOLE)])
def test_a_mirrored_motion_gives_the_mirrored_trajectory(clip: str, smoothing: Smoothing) -> None:
    motion, robot = read_motion(SAMPLES / f"{clip}.bvh").resample(15), load_robot("op3")
    here, there = (retarget(m, robot, smoothing=smoothing, options=FREE).trajectory for m in (motion, mirrored(motion)))
    hinges, sides = robot.qpos_index, mirror_of(robot, LEFT)
    assert np.abs(sides.angles(here.qpos[:, hinges]) - there.qpos[:, hinges]).max() < 1e-3
