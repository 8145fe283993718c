"""What the figures of a score must do when the trajectory is changed in a known way."""

import importlib
import pkgutil
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from judged_files import numbers
from made_trajectories import hold, lifted, robot_of, swing
from shared_files import ROOT

import robot_retarget as rr
from robot_retarget.scores.figure import Measure
from robot_retarget.scores.score import FIGURES, MEASURES, score


@pytest.fixture(scope="module")
def robot() -> rr.Robot:
    return rr.load_robot("op3")


def test_a_robot_that_stands_still_has_no_defect(robot: rr.Robot) -> None:
    found = score(hold(robot), robot).figures
    still = (
        "skate_cm_s",
        "self_pen_pct",
        "limit_frames",
        "speed_p99",
        "jerk_rms",
        "joint_jumps",
        "flight_pct",
        "travel_m",
    )
    assert not any(found[name] for name in still)
    assert found["root_residual"] == 0
    assert found["zmp_out_pct"] == 0
    assert found["physics_score"] == pytest.approx(100, abs=0.5)


def test_lifting_the_robot_raises_its_float_by_as_much(robot: rr.Robot) -> None:
    stands = hold(robot)
    before, after = (numbers(score(t, robot).figures)["float_med_cm"] for t in (stands, lifted(stands, 0.037)))
    assert after - before == pytest.approx(3.7)


def test_sinking_the_robot_counts_as_penetration_by_both_definitions(robot: rr.Robot) -> None:
    stands = hold(robot)
    floor = numbers(score(stands, robot).figures)["float_med_cm"] / 100
    found = numbers(score(lifted(stands, -floor - 0.03), robot).figures)
    assert found["ground_pen_max_cm"] == pytest.approx(3, abs=0.01)
    assert found["omni_pen_cm"] == pytest.approx(3, abs=0.05)
    assert found["omni_pen_pct"] == 100


def test_free_fall_needs_no_contact_and_hovering_needs_a_whole_weight(robot: rr.Robot) -> None:
    """Newton's law is the oracle: the root lacks nothing on a parabola and m g in mid-air."""
    stands, times = hold(robot, 1.0, 100.0), np.arange(101) / 100
    up = np.maximum(2.0 * (times - 0.3) - 9.81 / 2 * (times - 0.3) ** 2, 0) * (times > 0.3)
    long = hold(robot, 10.0, 20.0)
    thrown = numbers(score(lifted(stands, up), robot).figures)
    hovering = numbers(score(lifted(long, np.where(np.arange(len(long)) < 20, 0.0, 0.3)), robot).figures)
    assert thrown["flight_pct"] == pytest.approx(40, abs=5)
    assert thrown["root_residual"] < 0.35 * hovering["root_residual"]
    assert hovering["root_residual_p95"] == pytest.approx(1, abs=0.01)


def test_a_slower_motion_has_slower_joints_and_less_jerk(robot: rr.Robot) -> None:
    fast = swing(robot, robot.joint_names[0], 0.3, 1.0, 2.0)
    slow = replace(fast, fps=fast.fps / 2, source_time=fast.source_time * 2)
    a, b = (numbers(score(t, robot).figures) for t in (fast, slow))
    assert b["speed_p99"] == pytest.approx(a["speed_p99"] / 2, abs=0.01)
    assert b["jerk_rms"] == pytest.approx(a["jerk_rms"] / 8, abs=0.1)


def test_the_physics_score_falls_with_every_defect(robot: rr.Robot) -> None:
    stands = hold(robot)
    clean = numbers(score(stands, robot).figures)["physics_score"]
    shaken = stands.qpos.copy()
    shaken[:, robot.qpos_index] += 0.05 * (np.arange(len(shaken)) % 2)[:, None]
    for worse in (lifted(stands, 0.03), lifted(stands, -0.03), replace(stands, qpos=shaken)):
        assert numbers(score(worse, robot).figures)["physics_score"] < clean - 5


def test_a_motion_compared_with_itself_turned_and_moved_scores_the_same(robot: rr.Robot) -> None:
    """Figures do not depend on where the robot begins and which way it looks."""
    motion = rr.read_motion(ROOT / "samples/wave.bvh")
    made = replace(hold(robot, 1.0, 30.0), source="wave.bvh")
    turned = made.qpos.copy()
    c, s = np.cos(0.6), np.sin(0.6)
    turned[:, :2] = turned[:, :2] @ [[c, s], [-s, c]] + [0.4, -0.2]
    half = np.array([np.cos(0.3), 0, 0, np.sin(0.3)])
    w, x, y, z = turned[:, 3:7].T
    turned[:, 3:7] = np.stack(
        [half[0] * w - half[3] * z, half[0] * x - half[3] * y, half[0] * y + half[3] * x, half[0] * z + half[3] * w],
        axis=1,
    )
    a, b = (numbers(score(t, robot, motion).figures) for t in (made, replace(made, qpos=turned)))
    assert b == pytest.approx(a, abs=0.011)


def test_a_single_frame_has_a_score(robot: rr.Robot) -> None:
    one = replace(hold(robot), qpos=hold(robot).qpos[:1], source_time=np.zeros(1))
    found = score(one, robot).figures
    assert found["float_med_cm"] is not None
    assert found["speed_p99"] is found["jerk_rms"] is found["root_residual"] is found["physics_score"] is None


def test_a_robot_without_feet_has_the_figures_that_need_none(tmp_path: Path) -> None:
    arm = robot_of(
        '<mujoco><worldbody><body><joint name="a" type="hinge" axis="0 1 0" range="-90 90"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 .3" size=".03"/></body></worldbody></mujoco>',
        tmp_path / "arm.xml",
    )
    moves = rr.Trajectory(np.linspace(0, 1, 20)[:, None], 10.0, ("a",), "arm")
    found = score(moves, arm).figures
    assert found["speed_p99"] == pytest.approx(0.53)
    assert found["float_med_cm"] is found["limb_deg_mean"] is found["travel_m"] is None


def test_a_trajectory_of_another_robot_is_refused(robot: rr.Robot) -> None:
    with pytest.raises(rr.RobotRetargetError, match="trajectory is of 'another'"):
        score(rr.Trajectory(np.tile([0, 0, 0, 1.0, 0, 0, 0, 0], (3, 1)), 30.0, ("strange",), "another"), robot)


def test_every_figure_has_a_unit_a_range_and_a_source_in_its_file() -> None:
    for module in pkgutil.iter_modules(importlib.import_module("robot_retarget.scores").__path__):
        own = importlib.import_module(f"robot_retarget.scores.{module.name}")
        if any(isinstance(value, Measure) for value in vars(own).values()) and module.name != "table":
            said = (own.__doc__ or "").lower()
            for word in ("unit", "range"):
                assert word in said, f"{module.name} does not state its {word}"


def test_every_figure_has_a_name_of_its_own() -> None:
    assert len(FIGURES) == sum(len(measure.figures) for measure in MEASURES)


def test_the_document_lists_every_figure_with_its_unit() -> None:
    assert "<!-- figures -->" in (ROOT / "docs/reference/scores.md").read_text(encoding="utf-8")
    text = runpy.run_path(str(ROOT / "scripts/tools/docs_hooks.py"))["figure_list"]()
    for figure in FIGURES.values():
        assert f"| `{figure.name}` | {figure.unit or '1'} | {figure.better} |" in text


def test_a_motion_other_than_the_recorded_source_is_noted(robot: rr.Robot) -> None:
    motion = rr.read_motion(ROOT / "samples/wave.bvh")
    own = replace(hold(robot, 1.0, 30.0), source="wave.bvh", source_sha256=motion.source_sha256)
    assert not any("contents differ" in note for note in score(own, robot, motion).notes)
    assert any("contents differ" in note for note in score(replace(own, source_sha256="0" * 64), robot, motion).notes)
