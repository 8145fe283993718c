"""The human of a retargeting is recognised, placed and described once."""

import cProfile
import pstats
import shutil
from collections import Counter
from pathlib import Path

import pytest
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.base.choices import Balance
from robot_retarget.base.files import SAMPLES

MOST = {
    "human/recognition/recognise.py:recognise": 1,
    "human/features.py:floor_under": 1,
    "contact/rule.py:contact_schedule": 1,
    "human/features.py:calibrate": 1,
    "human/recognition/recognise.py:place": 9,
}
"""Calls from file to likeness; the reader places keypoints again after each repair."""


@pytest.mark.parametrize("balance", ["off", "static"])
def test_the_human_of_a_retargeting_is_read_once(balance: Balance, tmp_path: Path) -> None:
    profile = cProfile.Profile()
    profile.runcall(_retargeted, shutil.copy(SAMPLES / "clap.bvh", tmp_path), balance)
    home, calls = str(ROOT / "robot_retarget") + "/", Counter[str]()
    for (file, _, name), (_, count, *_) in vars(pstats.Stats(profile))["stats"].items():
        if file.startswith(home):
            calls[f"{file.removeprefix(home)}:{name}"] += count
    assert {name: calls[name] for name in MOST if not 0 < calls[name] <= MOST[name]} == {}


def _retargeted(clip: str | Path, balance: Balance) -> float:
    motion = rr.read_motion(clip).frames(0, 20)
    return rr.retarget(motion, rr.load_robot("op3"), balance=balance).likeness.path_off
