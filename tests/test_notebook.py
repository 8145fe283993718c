"""Notebook cards show the main figures, and data frames hold the same numbers."""

import sys

import numpy as np
import pytest
from made_trajectories import swing

from robot_retarget.base.errors import UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.read import read_motion
from robot_retarget.judge.rollout import simulate
from robot_retarget.robot import load_robot
from robot_retarget.solver.pipeline import retarget

OP3 = load_robot("op3")
SWING = swing(OP3, "l_sho_roll", 0.4, 1.0, 0.5)
MOTION = read_motion(SAMPLES / "wave.bvh")


def test_values_say_in_a_line_what_they_are() -> None:
    report = simulate(SWING, OP3, others=False)
    for value, parts in (
        (MOTION, ("wave.bvh", f"{MOTION.duration:.2f} s", f"{len(MOTION)} at", "joints")),
        (OP3, ("op3", "20 joints", "kg", "a free root")),
        (SWING, ("swing on op3", "0.50 s", "51 at 100/s", "20 joints")),
        (report, (report.verdict, "op3", "pinned", *report.reasons)),
    ):
        assert all(part in repr(value) for part in parts), repr(value)
        shown = value._repr_html_()
        assert shown.startswith("<div") and parts[1].split(",")[0] in shown


def test_a_result_says_how_like_the_human_it_is() -> None:
    result = retarget(MOTION.frames(0, 30), OP3, balance="off")
    arms = f"arms {np.degrees(result.likeness.part('arms') or 0):.0f}°"
    for text in (repr(result), result._repr_html_()):
        assert "wave.bvh on op3" in text and arms in text


def test_html_is_escaped() -> None:
    named = type(SWING)(SWING.qpos, 100, SWING.joint_names, "op3", "<script>")
    assert "<script>" not in named._repr_html_()


def test_data_frames_hold_the_same_numbers() -> None:
    moved = SWING.to_frame()
    np.testing.assert_array_equal(moved.to_numpy(), SWING.qpos)
    assert moved.index[-1] == pytest.approx(0.5) and "l_sho_roll" in moved
    places = MOTION.to_frame()
    joint = MOTION.skeleton.names[3]
    np.testing.assert_array_equal(places[joint].to_numpy(), MOTION.positions[:, 3])
    report = simulate(SWING, OP3, others=False)
    np.testing.assert_array_equal(report.to_frame()["measured"].to_numpy(), report.series["measured"])


def test_without_pandas_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="needs pandas"):
        SWING.to_frame()
