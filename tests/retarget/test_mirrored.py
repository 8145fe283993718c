"""A mirrored motion gives the mirrored trajectory: no side is preferred, not even by the draws."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.motion import Motion, read_motion
from robot_retarget.retarget.clip import Smoothing
from robot_retarget.retarget.frame import Options
from robot_retarget.retarget.transfer import retarget
from robot_retarget.robot import Robot, load_robot
from robot_retarget.robot.mirror import mirror_of
from robot_retarget.shipped import SAMPLES

LEFT = np.array([0.0, 1.0, 0.0])


OTHER = {"Left": "Right", "Right": "Left", "L": "R", "R": "L", "l": "r", "r": "l"}


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged: joints, places and turns."""
    names = motion.skeleton.names
    side = re.compile("^(Left|Right|[LR](?=[A-Z])|[lr](?=hand))")
    other = [side.sub(lambda found: OTHER[found[0]], n) for n in names]
    order = [names.index(n) for n in other]
    turned = None if motion.rotations is None else motion.rotations[:, order] * [1, -1, 1, -1]
    return replace(motion, positions=motion.positions[:, order] * [1, -1, 1], rotations=turned)


def asymmetry(motion: Motion, robot: Robot, smoothing: Smoothing, options: Options) -> float:
    """By how much a hinge of the mirrored trajectory misses that of the mirrored motion, at most [rad]."""
    motions, hinges = (motion, mirrored(motion)), robot.qpos_index
    here, there = (retarget(m, robot, smoothing=smoothing, options=options).trajectory.qpos[:, hinges] for m in motions)
    return float(np.abs(mirror_of(robot, LEFT).angles(here) - there).max())


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
    motion = read_motion(SAMPLES / f"{clip}.bvh").resample(15)
    assert asymmetry(motion, load_robot("op3"), smoothing, options) < 1e-3


@needs_shared
@pytest.mark.parametrize(
    ("name", "clip", "smoothing"),
    [
        ("robotis_op3", SAMPLES / "walk.bvh", WHOLE),
        ("toddlerbot_2xc", SAMPLES / "wave.bvh", CAUSAL),
        # The human's left leg is longer than the right.
        ("robotis_op3", SHARED / "motions/bvh/cmu_hahne_3dsmax/jumping_jacks.bvh", CAUSAL),
    ],
)
def test_so_it_does_on_robots_whose_joints_mirror_each_other_and_whose_meshes_do_not(
    name: str, clip: Path, smoothing: Smoothing
) -> None:
    """But for links that near each other: there it is the meshes that say how far they may."""
    motion, robot = read_motion(clip).resample(10), load_robot(SHARED / f"robots/{name}/{name}.xml")
    assert asymmetry(motion, robot, smoothing, FREE) < 1e-3
