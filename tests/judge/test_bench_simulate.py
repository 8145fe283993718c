"""The benches run; a tick of a rollout makes few calls, and compensated goals are followed better."""

import cProfile
import runpy

import pytest
from made_trajectories import hold, swing
from shared_files import ROOT

from robot_retarget.judge.plant import Mode
from robot_retarget.judge.playback import roll_out
from robot_retarget.judge.rollout import plant_of
from robot_retarget.robot import load_robot

BENCH = runpy.run_path(str(ROOT / "scripts/bench/bench_simulate.py"))


def test_the_bench_prints_a_row_for_each_mode(capsys: pytest.CaptureFixture[str]) -> None:
    BENCH["report"](hold(load_robot("op3"), 1.0), "stand", 1, 2)
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[1] for row in rows] == ["pinned", "free"]


@pytest.mark.parametrize(("mode", "most"), [("pinned", 40), ("free", 60)])
def test_a_tick_of_a_rollout_makes_few_calls(mode: Mode, most: int) -> None:
    """Calls do not depend on the load of a machine; the start of a rollout is left out."""
    robot, counted = load_robot("op3"), []
    plant = plant_of(robot, mode)
    for seconds in (1.0, 2.0):
        profile = cProfile.Profile()
        rollout = profile.runcall(roll_out, plant, hold(robot, seconds), mode)
        counted.append((sum(entry.callcount for entry in profile.getstats()), len(rollout.times)))
    (fewer, short), (more, long) = counted
    assert (more - fewer) / (long - short) < most


def test_the_tracking_bench_finds_compensation_better() -> None:
    bench, robot = runpy.run_path(str(ROOT / "scripts/bench/bench_tracking.py")), load_robot("op3")
    plain, better, worst = bench["simulated"](robot, swing(robot, "l_el", 0.4, 0.5, 2.0), "pinned")
    assert better < plain / 2 and worst.startswith("l_el")
