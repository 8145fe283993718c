"""Versions of MuJoCo that give wrong results are refused with the reason; those that were tried are not."""

import runpy

import pytest
from shared_files import ROOT

from robot_retarget.base.errors import RobotError
from robot_retarget.base.mujoco_setup import check, require_mujoco


@pytest.mark.parametrize("version", ["3.12.0", "3.17.0", "4.0.1", "4.1.0rc1", "10.0"])
def test_versions_that_were_tried_and_newer_ones_are_taken(version: str) -> None:
    check(version)
    require_mujoco()


@pytest.mark.parametrize(
    ("version", "reason"),
    [("3.11.0", "finds no distance"), ("3.3.7", "older than 3.12"), ("2.3.7", "older"), ("4.0.0", "sparse Hessians")],
)
def test_wrong_and_old_versions_are_refused_with_the_reason_and_the_command(version: str, reason: str) -> None:
    with pytest.raises(
        RobotError, match=rf"MuJoCo {version} cannot be used: .*{reason}.*pip install 'mujoco>=3.12,<4'"
    ):
        check(version)


def test_the_script_that_tries_versions_names_tests_that_exist() -> None:
    tests = runpy.run_path(str(ROOT / "scripts/tools/mujoco_versions.py"))["TESTS"]
    assert [test for test in tests if not (ROOT / test).exists()] == []
