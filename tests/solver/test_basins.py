"""Whole clips stay in the basins that descents from drawn poses find to be the cheapest, frame by frame."""

import runpy

import numpy as np
import pytest
from shared_files import ROOT, SHARED, needs_shared

from robot_retarget.base.files import SAMPLES
from robot_retarget.graph.describe import describe
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot
from robot_retarget.solver.options import Search

SCRIPT = runpy.run_path(str(ROOT / "scripts/bench/basins.py"))


@pytest.mark.parametrize("clip", ["wave", "clap"])
def test_the_median_frame_is_within_a_twentieth_of_the_best_of_twelve_starts(clip: str) -> None:
    graph = describe(read_motion(SAMPLES / f"{clip}.bvh"), load_robot("op3"), fps=15)
    found = SCRIPT["excess"](graph, 20)
    assert len(found.frames) == len(range(10, len(graph), 20)) and (found.basin <= found.as_it_is + 0.02).all()
    assert np.median(found.basin) < 0.05
    cells = SCRIPT["row"]("op3", clip, found).split(" | ")
    assert cells[1:3] == [clip, str(len(found.frames))] and len(cells) == 7


@needs_shared
def test_without_candidates_a_clip_is_found_out() -> None:
    """The script tells a clip that stays in a worse basin from one that does not."""
    motion = read_motion(SHARED / "motions/bvh/fair1_zup/dab.bvh")
    graph = describe(motion, load_robot(SHARED / "robots/robotis_op3/robotis_op3.xml"), fps=15)
    single = Search(starts=0, every=100.0)
    one, several = (SCRIPT["excess"](graph, 20, search) for search in (single, None))
    assert one.basin.mean() > 2 * several.basin.mean()
