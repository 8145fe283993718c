"""A clip that is cut, laid down, renamed, mirrored, rewritten or broken is read as the same motion, or a note states the change.

Every law of `scripts/bench/check_human.py`, which counts them over all clips, on some of them.
"""

import runpy
from pathlib import Path
from typing import Any

import pytest
from shared_files import ROOT, SHARED, needs_shared

pytestmark = needs_shared
SOME = (
    "fair1_zup/dab.bvh",
    "mixamo/test_freebvh_walk.bvh",
    "makehuman_zup/mh_tpose_173j.bvh",
    "makehuman_zup/mh_zombieWalk1.bvh",
    "lafan1_procedural/backflip_procedural.bvh",
    "xsens_mvn/bvh_test2.bvh",
)


@pytest.fixture(scope="module")
def checks() -> Any:
    return runpy.run_path(str(ROOT / "scripts" / "bench" / "check_human.py"))


@pytest.fixture(scope="module", params=SOME, ids=lambda path: Path(path).stem)
def clip(checks: Any, request: pytest.FixtureRequest) -> Any:
    return checks["clip_of"](SHARED / "motions" / "bvh" / request.param)


LAWS = [
    "window_has_the_up_axis_of_the_whole",
    "who_is_laid_on_the_floor_lies",
    "window_has_the_map_of_the_whole",
    "renaming_changes_nothing",
    "mirroring_swaps_sides",
    "unit_and_axis_change_nothing",
    "what_is_clean_is_left_as_it_is",
    "a_jump_of_the_root_is_bridged_or_said",
    "a_limb_that_flies_is_bridged_or_said",
    "noise_is_taken_away_or_said",
    "a_calibration_pose_is_dropped_or_said",
]


def test_these_are_the_laws_of_the_script(checks: Any) -> None:
    assert [law.__name__ for law in checks["LAWS"]] == LAWS


@pytest.mark.parametrize("law", LAWS)
def test_nothing_is_silently_taken_for_something_else(checks: Any, clip: Any, law: str) -> None:
    outcomes = list(next(one for one in checks["LAWS"] if one.__name__ == law)(clip))
    assert checks["SILENT"] not in outcomes
