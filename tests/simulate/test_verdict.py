"""One badge: the same words in the terminal, in report.json, on the report page and in the viewer."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from made_trajectories import hold

from robot_retarget.cli import console
from robot_retarget.robot import load_robot
from robot_retarget.simulate.report import Report
from robot_retarget.simulate.rollout import simulate
from robot_retarget.simulate.verdict import Badge
from robot_retarget.view.page import save_page
from robot_retarget.view.web.pack import Packer
from robot_retarget.view.web.show import take_header
from robot_retarget.view.web.take import take_of

OP3 = load_robot("op3")


@pytest.fixture(scope="module")
def held() -> Report:
    return simulate(hold(OP3, 0.3), OP3)


def test_every_badge_has_its_own_words() -> None:
    badges = [Badge(*flags) for flags in itertools.product((False, True), repeat=4)]
    assert len({badge.text for badge in badges if badge.passed}) == 8
    assert Badge(True).text == "pass (pinned)"
    assert Badge(True, unlike=True, pinned=False, feedback=True).text == "pass, but unlike (free, with feedback)"
    assert Badge(False, unlike=True, pinned=False).text == "fail (free)"


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
