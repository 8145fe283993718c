"""The OP3's ranges are ROBOTIS's: what its kinematics source allows, and what its own motions play.

The pitch of the shoulders keeps the source's ±90°, though motions play up to 162°: beyond, an arm reaches every place in two
ways that differ by π, and the poses of streams and touch-ups depend on their start.
"""

import numpy as np
import pytest

from robot_retarget.robot import load_robot

OP3 = load_robot("op3")
TICK = 360 / 4096
"""Ranges end on ticks of the servos [degrees]."""
KINEMATICS = {
    "head_pan": (-90, 90), "head_tilt": (-90, 90), "l_sho_pitch": (-90, 90), "l_sho_roll": (-54, 90), "l_el": (-90, 90),
    "l_hip_yaw": (-81, 81), "l_hip_roll": (-54, 54), "l_hip_pitch": (-72, 72), "l_knee": (-18, 126), "l_ank_pitch": (-81, 81),
    "l_ank_roll": (-81, 81),
}  # fmt: skip
"""Of op3_kinematics_dynamics.cpp [degrees]."""
PLAYED = {
    "sho_roll": (-104.3, 86.3, -85.8, 104.2), "el": (-147.4, 5.4, -1.8, 147.3),
    "hip_yaw": (-13.2, 13.2, -13.3, 13.1), "hip_roll": (-26.2, -0.1, -0.1, 26.1), "hip_pitch": (-111.5, 28.0, -28.1, 111.4),
    "knee": (-0.1, 142.3, -141.4, -0.1), "ank_pitch": (-28.0, 103.5, -103.6, 28.9), "ank_roll": (-68.8, 13.2, -13.3, 68.7),
}  # fmt: skip
"""Least and largest angle of the left and of the right joint in data/motion_4095.bin of op3_action_module [degrees]."""


def span(joint: str) -> tuple[float, float]:
    k = OP3.joint_names.index(joint)
    return float(np.degrees(OP3.lower[k])), float(np.degrees(OP3.upper[k]))


@pytest.mark.parametrize(("joint", "wanted"), KINEMATICS.items())
def test_no_range_is_narrower_than_that_of_the_kinematics_source(joint: str, wanted: tuple[float, float]) -> None:
    low, high = span(joint)
    assert low <= wanted[0] + TICK and high >= wanted[1] - TICK


@pytest.mark.parametrize(("joint", "angles"), PLAYED.items())
def test_every_angle_that_the_robot_s_own_motions_play_is_in_range_and_no_range_goes_far_beyond(
    joint: str, angles: tuple[float, float, float, float]
) -> None:
    left, right = span(f"l_{joint}"), span(f"r_{joint}")
    assert left == pytest.approx((-right[1], -right[0])), "left and right are mirrored"
    least, most = min(angles[0], -angles[3]), max(angles[1], -angles[2])
    assert left[0] <= least + TICK and left[1] >= most - TICK
    source = KINEMATICS[f"l_{joint}"]
    assert left[0] >= min(least, source[0]) - 2 and left[1] <= max(most, source[1]) + 2


def test_the_servo_map_has_the_ranges_of_the_model() -> None:
    assert OP3.servo_map is not None
    for joint in OP3.joint_names:
        assert np.degrees(OP3.servo_map[joint].reach) == pytest.approx(span(joint), abs=0.01)
