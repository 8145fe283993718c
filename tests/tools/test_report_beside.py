"""A report next to a trajectory file gives the viewer its badge, its mode and the simulated motion."""

from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold

from robot_retarget.base.choices import Stand
from robot_retarget.base.errors import UsageError
from robot_retarget.judge.report import Report
from robot_retarget.judge.rollout import report_beside, simulate
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import load_trajectory

OP3 = load_robot("op3")


@pytest.mark.parametrize(("mode", "name"), [("free", "report.json"), ("pinned", "report.pinned.json")])
def test_a_report_beside_a_file_shows_what_was_judged(mode: Stand, name: str, tmp_path: Path) -> None:
    report = simulate(hold(OP3, 0.4), OP3, mode=mode)
    assert report.trajectory is not None
    path = report.trajectory.save(tmp_path / "hold.npz")
    report.save(tmp_path / name)
    found = report_beside(path, load_trajectory(path), OP3)
    assert found is not None and found.badge == report.badge and found.contract() == report.contract()
    assert np.allclose(found.series["simulated"], report.series["simulated"], atol=1e-9)
    assert report_beside(path, load_trajectory(path), OP3, "free" if mode == "pinned" else "pinned") is None
    hold(OP3, 0.5).save(path)  # another trajectory: the report is not about it
    assert report_beside(path, load_trajectory(path), OP3) is None


def test_a_report_on_loose_joints_is_shown_as_it_was_judged(tmp_path: Path) -> None:
    report = simulate(hold(OP3, 0.4), OP3, mode="pinned", backlash=0.01)
    assert report.trajectory is not None
    path = report.trajectory.save(tmp_path / "hold.npz")
    report.save(tmp_path / "report.pinned.json")
    found = report_beside(path, load_trajectory(path), OP3)
    assert found is not None and np.allclose(found.series["simulated"], report.series["simulated"], atol=1e-9)


def test_an_edited_report_is_no_report(tmp_path: Path) -> None:
    path = simulate(hold(OP3, 0.2), OP3).save(tmp_path / "report.json")
    path.write_text(path.read_text().replace('"pinned"', '"free"'))
    with pytest.raises(UsageError, match="was edited"):
        Report.load(path)
