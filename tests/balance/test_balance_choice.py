"""Which robots are balanced by default."""

import shutil
from pathlib import Path

from robot_retarget.balance.balance import balance_of
from robot_retarget.robot import load_robot
from robot_retarget.shipped import MODELS


def test_servos_from_another_folder_mean_a_robot_that_stands_free(tmp_path: Path) -> None:
    model = shutil.copytree(MODELS / "op3", tmp_path / "own") / "op3.xml"
    servos = (model.parent / "servos.toml").rename(tmp_path / "my.toml")
    assert balance_of(load_robot(model), "auto", "auto") == "off"
    assert balance_of(load_robot(model, None, servos), "auto", "auto") == "static"
