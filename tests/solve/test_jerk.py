"""What comes out jerks no more than what went in: the noise of a depth camera does not reach the joints."""

from dataclasses import replace

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.motion import Motion
from robot_retarget.motion.formats.bvh import read_bvh
from robot_retarget.motion.upright import upright
from robot_retarget.robot import load_robot
from robot_retarget.transfer import retarget

CLIP = SHARED / "motions" / "bvh" / "soma30_derived" / "soma30_walk_then_sneak.bvh"


def jerk(motion: Motion) -> float:
    """Root mean square of the joints' third differences [rad/s³]."""
    robot = load_robot("op3")
    trajectory = retarget(motion.frames(0, 120), robot).trajectory
    q = trajectory.qpos[:, robot.qpos_index]
    return float(np.sqrt((np.diff(q, 3, axis=0) ** 2).mean()) * trajectory.fps**3)


@needs_shared
@pytest.mark.parametrize("size", [0.005, 0.02])
def test_noise_of_a_camera_at_most_doubles_the_jerk_of_the_joints(size: float) -> None:
    capture = replace(read_bvh(CLIP), rotations=None)
    noise = np.random.default_rng(0).normal(0, 100 * size, capture.positions.shape)
    noisy = upright(replace(capture, positions=capture.positions + noise))
    assert jerk(noisy) < 2 * jerk(upright(capture))
