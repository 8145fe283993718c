"""Figures are told in units of daily life."""

import pytest

from robot_retarget.judge.verdict import shown


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [(-0.0, "m", "0 mm"), (0.0619, "m", "61.9 mm"), (0.2, "rad", "11.5°"), (2.08, "times", "2.08 times")],
)
def test_a_figure_is_told_in_a_unit_of_daily_life(value: float, unit: str, told: str) -> None:
    assert shown(value, unit) == told
