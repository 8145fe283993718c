"""The script that follows references of several retargeters compares each with the human at the same times."""

import runpy
from pathlib import Path

import pytest
from shared_files import ROOT

import robot_retarget as rr

TRACK = runpy.run_path(str(ROOT / "scripts/bench/track.py"), run_name="track")


def test_a_file_of_another_retargeter_is_compared_with_the_part_of_the_clip_that_it_was_made_from(
    tmp_path: Path,
) -> None:
    """The same motion through a file without times, and in the run itself."""
    robot, motion = rr.load_robot("op3"), rr.read_motion(ROOT / "samples/wave.bvh").frames(60, 90)
    own = rr.retarget(motion, robot, balance="off").trajectory
    file = tmp_path / "clip.csv"
    rr.export(own, robot, "csv", file)
    limbs = [
        TRACK["limbs_of"](each, each, robot, motion)
        for each in (own, TRACK["in_step"](rr.load_trajectory(file, robot), motion))
    ]
    assert limbs[0] > 1 and limbs[1] == pytest.approx(limbs[0], abs=0.1)
