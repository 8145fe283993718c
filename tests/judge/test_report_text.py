"""Figures are told in units of daily life."""

import pytest

from robot_retarget.judge.report import Report
from robot_retarget.judge.report_text import attempted, judged_lines
from robot_retarget.judge.verdict import shown


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [(-0.0, "m", "0 mm"), (0.0619, "m", "61.9 mm"), (0.2, "rad", "11.5°"), (2.08, "times", "2.08 times")],
)
def test_a_figure_is_told_in_a_unit_of_daily_life(value: float, unit: str, told: str) -> None:
    assert shown(value, unit) == told


def test_a_limit_that_is_exceeded_by_less_than_is_shown_states_the_difference_in_tables_and_reasons() -> None:
    known = {"unstable_s": None, "worst_joint_rms_rad": 0.2004, "plan_margin_m": 0.00699, "worst_joint": "l_knee"}
    report = Report("fail", (), known, "", "op3")
    tracking, margin = (line for line in judged_lines(report) if not line.held)
    assert (tracking.value, tracking.most) == ("11.5°", "11.5° by 0.0229°")
    assert (margin.value, margin.most) == ("6.99 mm", "at least 7 mm")
    known["plan_margin_m"] = 0.0069999
    assert judged_lines(report)[-1].most == "at least 7 mm by 0.0001 mm"


def test_every_attempt_at_balance_is_a_row_with_its_reasons_also_from_a_file_that_lacks_some() -> None:
    refused = {"legs": "follow", "mode": "static", "reach": 0.5, "solved": 0, "slowdown": 2.6, "reasons": "too slow"}
    stands = {
        "legs": "stand",
        "mode": "static",
        "reach": 1.0,
        "solved": 1,
        "slowdown": 1.0,
        "margin_m": 0.02,
        "reasons": "",
    }
    assert attempted({"attempts": [refused, stands]}) == [
        ("steps of the human, static", "50 %", "2.6", "–", "0", "too slow"),
        ("both feet in place, static", "100 %", "1", "20 mm", "1", "nothing"),
    ]
    assert attempted({}) == [] and len(attempted({"attempts": [{}]})) == 1
