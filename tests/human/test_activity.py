"""Clips are classified by the use of the feet."""

from dataclasses import replace

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.errors import BalanceError
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.features import Activity, features_of

BVH = SHARED / "motions/bvh"
OP3 = rr.load_robot("op3")


def activity(motion: rr.Motion) -> Activity:
    return features_of(motion, rr.match(motion, OP3)).activity


def kind(motion: rr.Motion) -> str:
    return activity(motion).kind


@pytest.mark.parametrize(("clip", "expected"), [("clap", "in place"), ("squat", "in place"), ("walk", "stepping")])
def test_sample_clips_are_what_their_names_say(clip: str, expected: str) -> None:
    assert kind(rr.read_motion(SAMPLES / f"{clip}.bvh")) == expected


@needs_shared
@pytest.mark.parametrize(
    ("clip", "expected"),
    [
        ("fair1_zup/jumping.bvh", "flight"),
        ("xsens_mvn/BVH2SMPL_Sit54.bvh", "supported"),
        ("lafan1_procedural/fall_getup_procedural.bvh", "supported"),
        ("cmu_cgspeed_motionbuilder/02_01_walk.bvh", "stepping"),
    ],
)
def test_real_clips_are_what_their_names_say(clip: str, expected: str) -> None:
    assert kind(rr.read_motion(BVH / clip)) == expected


def test_a_hop_is_a_flight_at_its_time() -> None:
    motion = rr.read_motion(SAMPLES / "squat.bvh")
    time = np.arange(len(motion)) / motion.fps
    hop = 0.5 * np.clip(1 - ((time - 1.0) / 0.2) ** 2, 0, None)
    lifted = replace(motion, positions=motion.positions + hop[:, None, None] * [0.0, 0.0, 1.0])
    found = activity(lifted)
    assert found.kind == "flight" and 0.7 < found.since < 0.95 < 1.05 < found.until < 1.3


@needs_shared
def test_a_human_on_a_chair_is_refused_with_the_reason_and_the_way_out() -> None:
    motion = rr.read_motion(BVH / "xsens_mvn/BVH2SMPL_Sit54.bvh").resample(15)
    with pytest.raises(BalanceError, match=r"a chair, hands on the floor.*from \d+\.\d to \d+\.\d s.*legs 'stand'"):
        rr.retarget(motion, OP3, balance="static", legs="follow")
