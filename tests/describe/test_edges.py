"""What is wished of pairs of keypoints: touches above all."""

import numpy as np
import pytest

from robot_retarget.describe.edges import build_edges
from robot_retarget.describe.match import match
from robot_retarget.motion import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.shipped import SAMPLES


@pytest.mark.parametrize(
    ("clip", "touching"),
    [
        ("walk", set()),  # hands that swing past hips touch nothing
        ("clap", {("l_hand", "r_hand")}),
        ("hips_and_bow", {("l_hand", "l_hip"), ("r_hand", "r_hip")}),
    ],
)
def test_what_touches_in_a_sample_clip_and_nothing_else_counts_as_a_touch(
    clip: str, touching: set[tuple[str, str]]
) -> None:
    motion = read_motion(SAMPLES / f"{clip}.bvh")
    matched = match(motion, load_robot("op3"))
    edges = build_edges(motion, matched)
    pairs = edges.pairs[edges.touching[np.flatnonzero(edges.touch.max(axis=0) > 0)]]
    assert {(matched.keypoints[a], matched.keypoints[b]) for a, b in np.sort(pairs, axis=1)} == touching
