"""The benches run; a rollout costs about what its steps cost, and compensated goals are followed better."""

import runpy

import pytest
from made_trajectories import hold, swing
from shared_files import ROOT

from robot_retarget.robot import load_robot

BENCH = runpy.run_path(str(ROOT / "scripts/bench/bench_simulate.py"))


def test_the_bench_prints_a_row_for_each_mode_and_no_great_overhead(capsys: pytest.CaptureFixture[str]) -> None:
    ratios = BENCH["report"](hold(load_robot("op3"), 1.0), "stand", 5, 2)
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[1] for row in rows] == ["pinned", "free"]
    assert max(ratios) < 1.6  # 1.35 measured: a clip of one second carries its start


def test_the_tracking_bench_finds_compensation_better() -> None:
    bench, robot = runpy.run_path(str(ROOT / "scripts/bench/bench_tracking.py")), load_robot("op3")
    plain, better, worst = bench["simulated"](robot, swing(robot, "l_el", 0.4, 0.5, 2.0), "pinned")
    assert better < plain / 2 and worst.startswith("l_el")
