"""Clips are classified by the use of the feet."""

from dataclasses import replace

import numpy as np
import pytest
from shared_files import SHARED, needs_shared

import robot_retarget as rr
from robot_retarget.base.errors import BalanceError
from robot_retarget.base.files import SAMPLES
from robot_retarget.contact.record import ContactRecord, standing_on
from robot_retarget.human.activity import Activity, activity_of
from robot_retarget.human.features import features_of
from robot_retarget.solver import pipeline

BVH = SHARED / "motions/bvh"
OP3 = rr.load_robot("op3")


def activity(motion: rr.Motion) -> Activity:
    return features_of(motion, rr.match(motion, OP3)).activity


def record(*feet: np.ndarray) -> ContactRecord:
    """Of feet that stand on toe and heel as (T, 2) says."""
    return standing_on(("l", "r"), np.stack(feet, axis=1))


def kind(motion: rr.Motion) -> str:
    return activity(motion).kind


@pytest.mark.parametrize(("clip", "expected"), [("clap", "in place"), ("squat", "in place"), ("walk", "stepping")])
def test_sample_clips_are_what_their_names_say(clip: str, expected: str) -> None:
    assert kind(rr.read_motion(SAMPLES / f"{clip}.bvh")) == expected


@pytest.mark.parametrize(("lifted", "expected"), [(9, "in place"), (11, "stepping")])
def test_a_human_who_lifts_a_foot_for_more_than_a_tenth_of_the_time_steps(lifted: int, expected: str) -> None:
    never, stands = np.zeros(100, bool), np.ones((100, 2), bool)
    steps = stands.copy()
    steps[40 : 40 + lifted] = False
    assert activity_of(never, never, record(stands, steps), 30.0).kind == expected


@pytest.mark.parametrize(("seated", "expected"), [(9, "in place"), (11, "supported")])
def test_a_human_who_sits_for_more_than_a_tenth_of_the_time_is_held_up(seated: int, expected: str) -> None:
    stands, sits = np.ones((100, 2), bool), np.arange(100) < seated
    assert activity_of(sits, np.zeros(100, bool), record(stands, stands), 30.0).kind == expected


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
def test_a_human_on_a_chair_is_refused_with_the_reason_and_the_way_out_before_a_solve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pipeline, "solve_graph", lambda *_, **__: pytest.fail("solved in vain"))
    motion = rr.read_motion(BVH / "xsens_mvn/BVH2SMPL_Sit54.bvh").resample(15)
    with pytest.raises(BalanceError, match=r"a seat, hands or the floor.*from \d+\.\d to \d+\.\d s.*legs 'stand'"):
        rr.retarget(motion, OP3, balance="static", legs="follow")
