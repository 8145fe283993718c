"""The command `warn`: its table, its JSON, its files, and what it says of bad input."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_trajectories import hold, wander
from typer.testing import CliRunner

from robot_retarget.base.errors import RobotRetargetError
from robot_retarget.collision import warnings_of
from robot_retarget.robot import Robot, load_robot
from robot_retarget.tools.cli import app
from robot_retarget.trajectory import load_trajectory


@pytest.fixture(scope="module")
def op3() -> Robot:
    return load_robot("op3")


@pytest.fixture
def colliding(op3: Robot, tmp_path: Path) -> Path:
    return wander(op3, 45, 30.0).save(tmp_path / "wander.npz")


def warn(*words: str | Path) -> str:
    found = CliRunner().invoke(app, ["warn", *map(str, words)], catch_exceptions=False)
    assert found.exit_code == 0
    return found.stdout


def test_json_holds_events_and_figures(colliding: Path, tmp_path: Path) -> None:
    facts = json.loads(warn(colliding, "--robot", "op3", "--json", "-o", tmp_path / "w.csv"))
    assert set(facts) == {"events", "figures"}
    assert facts["figures"]["events"] == len(facts["events"]) > 0
    for event in facts["events"]:
        assert {"pair", "first_warning", "predicted_contact", "contact", "lead_s"} <= set(event)
        assert event["contact"] is None or event["contact"] >= event["first_warning"]
    assert len((tmp_path / "w.csv").read_text().splitlines()) == 1 + len(facts["events"])


def test_a_file_is_followed_along_its_own_frames_and_as_a_stream_where_that_is_wanted(
    op3: Robot, colliding: Path
) -> None:
    moves, said = load_trajectory(colliding), dict[bool, list[Any]]()
    for planned, words in ((True, ()), (False, ("--last-step",))):
        said[planned] = json.loads(warn(colliding, "--json", *words))["events"]
        assert said[planned] == [event.contract() for event in warnings_of(moves, op3, planned=planned).events]
    assert said[True] != said[False] and warnings_of(moves, op3).events == warnings_of(moves, op3, planned=True).events


def test_the_table_names_pairs(colliding: Path, tmp_path: Path) -> None:
    said = warn(colliding, "--robot", "op3", "-o", tmp_path / "w.csv")
    assert "first warning" in said and "_link" in said


def test_bad_input_ends_in_a_sentence(op3: Robot, colliding: Path, tmp_path: Path) -> None:
    single = hold(op3, 0.0).save(tmp_path / "single.npz")
    other = replace(wander(op3, 5), joint_names=tuple(f"j{k}" for k in range(20))).save(tmp_path / "other.npz")
    broken = tmp_path / "broken.npz"
    with np.load(colliding) as archive:
        values = {key: archive[key] for key in archive.files}
    save: Any = np.savez
    save(broken, **(values | {"qpos": np.full_like(values["qpos"], np.nan)}))
    still = tmp_path / "still.npz"
    save(still, **(values | {"fps": 0.0}))
    for path, sentence in ((single, "two frames"), (other, "not of 'op3'"), (broken, "not finite"), (still, "fps")):
        with pytest.raises(RobotRetargetError, match=sentence):
            warn(path, "--robot", "op3", "-o", tmp_path / "w.csv")
    with pytest.raises(RobotRetargetError, match=r"\.csv"):
        warn(colliding, "--robot", "op3", "-o", tmp_path / "w.xyz")
    assert not (tmp_path / "w.csv").exists()
