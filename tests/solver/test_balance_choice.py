"""Which robots are balanced by default."""

import shutil
from dataclasses import replace
from pathlib import Path

import robot_retarget as rr
from robot_retarget.base.files import MODELS, SAMPLES
from robot_retarget.robot import load_robot
from robot_retarget.solver.balance.balance import balance_modes


def test_servos_from_another_folder_mean_a_robot_that_stands_free(tmp_path: Path) -> None:
    model = shutil.copytree(MODELS / "op3", tmp_path / "own") / "op3.xml"
    servos = (model.parent / "servos.toml").rename(tmp_path / "my.toml")
    assert balance_modes(load_robot(model), "auto", "auto") == ()
    assert balance_modes(load_robot(model, None, servos), "auto", "auto") == ("dynamic", "static")


def test_a_walk_too_fast_for_static_balance_walks_in_dynamic_balance_instead_of_standing() -> None:
    walk, robot = rr.read_motion(SAMPLES / "walk.bvh"), load_robot("op3")
    fast = replace(walk, fps=2.1 * walk.fps).resample(20)
    static = rr.retarget(fast, robot, balance="static").balance
    result = rr.retarget(fast, robot)
    assert static is not None and static.legs == "stand" and "2.5 times as long" in static.instead
    assert [row["solved"] for row in static.attempts if row["reasons"]] == [0]  # what cannot work is known before
    assert result.balance is not None and (result.balance.legs, result.balance.mode) == ("follow", "dynamic")
    assert result.trajectory.balance == "dynamic" and result.balance.margin.min() > 0
    assert rr.simulate(result.trajectory, robot, mode="free", draws=0).verdict == "pass"
