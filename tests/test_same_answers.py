"""Python and the command line give the same answers, and take the same things."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from forked import run
from shared_files import ROOT

import robot_retarget as rr

CLIP = ROOT / "samples/clap.bvh"


def timeless(figures: Mapping[str, Any]) -> dict[str, Any]:
    """The figures without the speed of the simulation."""
    return {name: value for name, value in figures.items() if name != "steps_per_second"}


@pytest.fixture(scope="module")
def result() -> rr.Result:
    return rr.retarget(rr.read_motion(CLIP).frames(0, 10), "op3")


@pytest.fixture(scope="module")
def report(result: rr.Result) -> rr.Report:
    return rr.simulate(result, draws=2)


def test_python_judges_as_the_command_line_does(result: rr.Result, report: rr.Report, tmp_path: Path) -> None:
    path = tmp_path / "clap.npz"
    assert run("solve", CLIP, "--robot", "op3", "--frames", "0:10", "-o", path).returncode == 0
    told = json.loads(run("simulate", path, "--robot", "op3", "--draws", 2, "--json", "--quiet").stdout)
    assert report.badge.text == told["badge"]["text"]
    assert report.trajectory_sha256 == told["trajectory_sha256"]
    assert timeless(report.figures) == timeless(told["figures"])


def test_a_result_brings_its_robot_its_warnings_and_its_likeness(result: rr.Result, report: rr.Report) -> None:
    spelled = rr.simulate(result.trajectory, "op3", warnings=result.warnings, draws=2)
    assert timeless(report.figures) == timeless(spelled.figures) and report.badge == spelled.badge
    assert report.figures["mode"] == "free" and {"foreseen", "limb_rad"} <= report.figures.keys()


def test_the_mode_follows_the_balance_through_the_file(result: rr.Result, tmp_path: Path) -> None:
    path = result.trajectory.save(tmp_path / "clap.npz")
    assert rr.load_trajectory(path).balance == "static"
    assert rr.simulate(path, draws=0).figures["mode"] == "free"
    carried = rr.retarget(rr.read_motion(CLIP).frames(0, 3), "op3", balance="off").trajectory
    assert rr.simulate(carried.save(path)).figures["mode"] == "pinned"


def test_a_result_is_scored_against_its_own_motion(result: rr.Result) -> None:
    own, spelled = rr.score(result), rr.score(result.trajectory, "op3", result.source)
    assert own.figures == spelled.figures and own.figures["limb_deg_mean"] is not None


def test_a_result_is_exported_to_a_file_that_names_read_again(result: rr.Result, tmp_path: Path) -> None:
    path = rr.export(result, None, "gmr", tmp_path / "clap.pkl")
    assert len(rr.load_trajectory(path, "op3")) == len(result.trajectory)
    assert next(rr.stream("op3", CLIP)).shape == result.trajectory.qpos[0].shape


def test_every_object_shows_itself_in_one_short_line(result: rr.Result, report: rr.Report) -> None:
    shown = (
        result, result.solution, result.graph, result.match, result.warnings, result.likeness, result.trajectory,
        result.motion, result.motion.skeleton, result.robot, report, rr.score(result), rr.view(result),
    )  # fmt: skip
    assert [repr(one) for one in shown if "\n" in repr(one) or len(repr(one)) > 250] == []
