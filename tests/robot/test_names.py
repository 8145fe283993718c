"""Robots are known by the names people type."""

import pytest

from robot_retarget.base.errors import RobotError
from robot_retarget.robot import load_robot
from robot_retarget.robot.catalog import humanoids, resolved

descriptions = pytest.importorskip("robot_descriptions._descriptions", reason="needs the extra descriptions")


@pytest.mark.parametrize(
    ("typed", "module"),
    [
        ("g1", "g1_mj_description"),
        ("unitree_g1", "g1_mj_description"),
        ("Unitree-G1", "g1_mj_description"),
        ("g1_description", "g1_description"),
        ("h1", "h1_mj_description"),
        ("h1_2", "h1_2_mj_description"),
        ("t1", "booster_t1_mj_description"),
        ("booster_t1", "booster_t1_mj_description"),
        ("toddlerbot", "toddlerbot_description"),
        ("toddlerbot_2xc", "toddlerbot_2xc_mj_description"),
        ("talos", "talos_mj_description"),
        ("berkeley_humanoid", "berkeley_humanoid_description"),
        ("valkyrie", "valkyrie_description"),
    ],
)
def test_a_name_means_the_robot_it_is_the_name_of(typed: str, module: str) -> None:
    assert resolved(typed, humanoids(descriptions.DESCRIPTIONS)) == module


def test_every_humanoid_of_the_package_is_known_by_its_own_name() -> None:
    entries = humanoids(descriptions.DESCRIPTIONS)
    assert len(entries) > 20 and all(resolved(module, entries) == module for module in entries)


def test_robots_that_are_no_humanoids_are_unknown() -> None:
    with pytest.raises(RobotError, match=r"unknown robot 'spot'; known: g1_class, op3.*g1"):
        load_robot("spot")


def test_what_cannot_be_fetched_is_said_with_the_line_that_gets_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", "/dev/null/nowhere")
    with pytest.raises(
        RobotError, match=r'g1 is g1_mj_description .* python -c "import robot_descriptions.g1_mj_description"'
    ):
        load_robot("g1")
