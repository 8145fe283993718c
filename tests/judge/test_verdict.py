"""One badge: the same words in the terminal, in report.json, on the report page and in the viewer."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold

from robot_retarget.base.errors import TrajectoryError
from robot_retarget.judge.report import Report
from robot_retarget.judge.report_text import facts
from robot_retarget.judge.rollout import simulate
from robot_retarget.judge.verdict import Badge, Thresholds, at_edge, judge
from robot_retarget.judge.worlds import NOMINAL
from robot_retarget.robot import load_robot
from robot_retarget.tools.cli import console
from robot_retarget.tools.view.page import save_page
from robot_retarget.tools.view.web.show import Packer, take_header
from robot_retarget.tools.view.web.take import take_of
from robot_retarget.trajectory import load_trajectory

OP3 = load_robot("op3")


@pytest.fixture(scope="module")
def held() -> Report:
    return simulate(replace(hold(OP3, 0.3), likeness={"limb_rad": 0.1}), OP3)


def test_every_badge_has_its_own_words() -> None:
    badges = [Badge(p, u, held, f, c) for p, u, held, f, c in itertools.product((False, True), repeat=5)]
    assert len({badge.text for badge in badges if badge.passed}) == 12
    assert Badge(True, pinned=False, edge=True).text == "pass, at the edge (free)"
    assert Badge(True, unlike=True, pinned=False, standing=False).text == "not playable standing (free)"
    assert (
        Badge(True, unlike=True, standing=False).text == "pass, but unlike (pinned)"
    )  # the pelvis is held: it is played
    assert Badge(True, pinned=False, standing=False).text == "pass (free)"  # it is played all the same
    assert Badge(True, pinned=False, pace=0.856).text == "pass (free, at 0.86 of the human's speed)"
    assert Badge(True).text == "pass (pinned)"
    assert Badge(True, unlike=True, pinned=False, feedback=True).text == "pass, but unlike (free, with feedback)"
    assert Badge(False, unlike=True, pinned=False).text == "fail (free)"
    assert Badge(True, compared=False).text == "pass, likeness not judged (pinned)"


def test_what_follows_from_another_reason_is_no_reason_of_its_own(held: Report) -> None:
    most = Thresholds()
    between = {"between_frames_depth_m": 0.02, "between_frames_s": 1.0, "between_frames_bodies": ["a", "b"]}
    deeper = between | {"self_contact_depth_m": 0.03}
    slip, fell = {"foot_slip_m": 1.0}, {"foot_slip_m": 1.0, "fall_s": 0.1, "fall_body": "head"}
    for figures, words, named in (
        (between, "between two frames", True),
        (deeper, "between two frames", False),
        (slip, "slides", True),
        (fell, "slides", False),
    ):
        assert any(words in reason for reason in judge({**held.figures, **figures}, most)) == named, figures
    assert [at_edge({"plan_margin_m": share * most.zmp_margin}, most) for share in (0.5, 1.5)] == [True, False]


def test_a_tracking_error_on_the_servos_of_the_verdict_is_not_told_as_that_of_others() -> None:
    errors = {"tracking_rms_rad": 0.1, "nominal_tracking_rms_rad": 0.1, "plain_tracking_rms_rad": 0.2}
    told = {what: value for what, value, _ in facts({**errors, "servos": NOMINAL})}
    assert told["the same elsewhere"] == "11.5° goals without compensation"
    told = {what: value for what, value, _ in facts({**errors, "servos": "drawn"})}
    assert told["the same elsewhere"] == "5.73° modelled servos, 11.5° goals without compensation"


def test_the_likeness_of_a_file_is_judged_as_it_was_found(tmp_path: Path) -> None:
    """A walk that stands, solved in one process and simulated in another."""
    found = {"limb_rad": 0.6, "limb_rad_legs": 0.6, "limbs_far_share": 1.0, "legs": "follow", "stride": None}
    path = replace(hold(OP3, 0.3), likeness=found).save(tmp_path / "walk.npz")
    report = simulate(path, OP3)
    assert report.badge.text == "pass, but unlike (pinned)"
    assert report.unlike == (
        "legs are 34° from the human's on average, 34.4° more than ranges of joints cost",
        "frames with limbs over 25° from the human's: 100 %, more than 5 %",
    )
    assert report.trajectory is not None and report.trajectory.likeness == found


def test_a_motion_that_was_not_compared_is_called_so(tmp_path: Path) -> None:
    like = replace(hold(OP3, 0.3), likeness={"limb_rad": 0.1})
    for motion in (hold(OP3, 0.3), like.altered(qpos=like.qpos[::-1])):
        report = simulate(motion, OP3)
        assert report.badge.text == "pass, likeness not judged (pinned)" and report.contract()["unlike"] is None


@pytest.mark.parametrize(
    "text", ["[1]", "{", "[" * 9000, '{"limb_rad": NaN}', '{"limb_rad": [1]}', '{"limb_rad": 1e400}']
)
def test_a_likeness_that_is_no_table_of_figures_is_refused(text: str, tmp_path: Path) -> None:
    hold(OP3, 0.3).save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as arrays:
        np.savez(tmp_path / "bad.npz", **{**arrays, "likeness": text})
    with pytest.raises(TrajectoryError, match="likeness is not a table of figures"):
        load_trajectory(tmp_path / "bad.npz")


@pytest.mark.parametrize("unlike", [(), ("it takes 3.0 times as long as the human",)])
def test_all_outputs_show_the_same_badge(
    held: Report,
    unlike: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    report, text = replace(held, unlike=unlike), f"pass{', but unlike' if unlike else ''} (pinned)"
    assert report.trajectory is not None
    page = save_page(report, report.trajectory, tmp_path / "report.html")
    assert isinstance(page, Path) and f'<div class="badge">{text}</div>' in page.read_text()
    assert report.contract()["badge"]["text"] == text and report.contract()["verdict"] == "pass"
    shown = take_header(take_of(report.trajectory, OP3, report=report), Packer())["report"]
    assert shown["badge"] == report.contract()["badge"] and shown["reasons"] == list(unlike)
    with console.out.capture() as printed:
        console.show_report(report)
    assert f"verdict: {text}" in printed.get()


def test_a_pinned_pass_of_a_robot_with_feet_names_how_to_test_balance(held: Report) -> None:
    assert any("legs 'stand'" in note for note in held.figures["notes"])


def test_ankles_are_called_too_soft_where_gravity_tips_the_robot_over_and_it_fell() -> None:
    report = simulate(hold(OP3, 0.1), OP3, mode="pinned", compensate=False, others=False)
    fell = dict(report.figures) | {"fall_s": 0.2, "fall_body": ""}
    for stiffness, named in ((39.0, True), (41.0, False), (None, False)):
        known = {"tipping_stiffness_Nm_rad": 40.0, "ankle_stiffness_Nm_rad": stiffness} if stiffness else {}
        found = judge(fell | known, Thresholds())
        assert any(reason.startswith("fell") for reason in found)
        assert any("too soft to stand on" in reason for reason in found) is named


def test_goals_beyond_what_playback_lets_through_and_links_inside_each_other_are_reasons_with_their_size() -> None:
    figures = dict(simulate(hold(OP3, 0.1), OP3, mode="pinned", compensate=False, others=False).figures)
    hidden = {"goal_step_joint": "l_knee", "goal_step_rad": 0.4, "goal_step_limit_rad": 0.5}
    assert judge(figures | hidden, Thresholds()) == judge(figures, Thresholds())
    (said,) = judge(figures | hidden | {"goal_step_rad": np.radians(30)}, Thresholds())
    assert said.startswith("l_knee is 30") and "holds goals back beyond 28.6" in said
    pair = {"bodies": ["l_el_link", "body_link"], "depth_m": 0.0123, "frames": 7}
    (said,) = judge(figures | {"self_contacts": [pair], "tracked_self_contacts": []}, Thresholds())
    assert said == "l_el_link and body_link overlap by up to 12.3 mm, touching in 7 frames"
