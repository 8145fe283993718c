"""Human and robot meet in the same words; what cannot be matched is refused with the reason."""

from pathlib import Path

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MatchError
from robot_retarget.base.files import SAMPLES
from robot_retarget.base.keypoints import KEYPOINTS
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot


def test_two_whole_bodies_share_every_keypoint() -> None:
    matched = match(read_motion(SAMPLES / "wave.bvh"), load_robot("op3"))
    assert matched.keypoints == KEYPOINTS
    assert matched.human_leg == pytest.approx(0.888, abs=1e-3)
    assert matched.leg_ratio == pytest.approx(0.22 / 0.888, rel=0.02)  # thigh and shin: OP3 over Table I


def test_bones_are_as_long_as_the_skeleton_says() -> None:
    matched = match(read_motion(SAMPLES / "wave.bvh"), load_robot("op3"))
    lengths = dict(zip(matched.keypoints, matched.human_bones, strict=True))
    table = {"l_knee": 0.435, "l_ankle": 0.453, "r_elbow": 0.273, "r_hand": 0.258, "r_toe": 0.125}
    assert {k: round(float(lengths[k]), 3) for k in table} == table
    assert dict(zip(matched.keypoints, matched.robot_bones, strict=True))["l_knee"] == pytest.approx(0.11015, abs=1e-6)


@needs_shared
def test_a_robot_without_arms_is_matched_over_what_it_has() -> None:
    robot = load_robot(SHARED / "robots/berkeley_humanoid/berkeley_humanoid.xml")
    matched = match(read_motion(SAMPLES / "walk.bvh"), robot)
    assert set(matched.keypoints) == {
        "pelvis",
        "chest",
        *(f"{s}_{k}" for s in "lr" for k in ("hip", "knee", "ankle", "toe")),
    }
    assert "partial humanoid: no arms and no head" in matched.notes


@needs_shared
def test_a_dog_is_refused() -> None:
    dog = read_motion(SHARED / "motions/bvh/nonhuman_negative/dog_walk_Bip01.bvh")
    with pytest.raises(MatchError, match="quadruped"):
        match(dog, load_robot("op3"))


def test_an_override_replaces_lines_on_either_side(tmp_path: Path) -> None:
    lines = tmp_path / "map.toml"
    lines.write_text('[human]\nl_hand = "LeftElbow"\n[robot]\nl_hand = ["l_el_link", 0, 0.02, 0]\n')
    matched = match(read_motion(SAMPLES / "wave.bvh"), load_robot("op3"), lines)
    assert matched.human_bones[matched.index("l_hand")] < 1e-9
    assert np.allclose(matched.anatomy.sites["l_hand"].offset, [0, 0.02, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[humans]\nl_hand = "LeftHand"', r"unknown table \[humans\]; did you mean 'human'\? known: human, robot"),
        ('[human]\nl_hand = "Paw"', "'Paw'"),
        ('[human]\npaw = "LeftElbow"', "'paw'"),
    ],
)
def test_a_wrong_override_says_what_is_known(tmp_path: Path, text: str, message: str) -> None:
    lines = tmp_path / "map.toml"
    lines.write_text(text)
    with pytest.raises(MatchError, match=message):
        match(read_motion(SAMPLES / "wave.bvh"), load_robot("op3"), lines)


@pytest.mark.parametrize("size", [0.03, 5.0])
def test_a_human_of_five_centimetres_or_eight_metres_is_refused(size: float) -> None:
    wave = read_motion(SAMPLES / "wave.bvh")
    with pytest.raises(MatchError, match=r"legs of .* m, where a body has 0\.1 to 2 m: positions are in metres"):
        match(Motion(wave.skeleton, size * wave.positions, wave.rotations, wave.fps), load_robot("op3"))
