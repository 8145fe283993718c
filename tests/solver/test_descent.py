"""The box of a hinge at a frame: its range, and the reach of its neighbours in time."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robot_retarget.solver.descent import Box, _rows

ANGLES = st.floats(-2, 2).map(lambda value: round(value, 3))


@given(st.lists(st.tuples(ANGLES, st.floats(0.01, 1.0)), min_size=1, max_size=3))
def test_a_box_around_neighbours_holds_what_all_of_them_reach_or_else_one_angle_between(
    neighbours: list[tuple[float, float]],
) -> None:
    """By brute force on a grid of angles."""
    whole = Box(np.array([-1.0]), np.array([1.5]))
    box = whole.around([(np.array([angle]), np.array([reach])) for angle, reach in neighbours])
    grid = np.linspace(-3.5, 3.5, 7001)
    reached = (grid >= -1.0) & (grid <= 1.5)
    for angle, reach in neighbours:
        reached &= np.abs(grid - angle) <= reach
    inside = grid[(grid >= box.lower) & (grid <= box.upper)]
    ends = (
        [-1.0, *(angle - reach for angle, reach in neighbours)],
        [1.5, *(angle + reach for angle, reach in neighbours)],
    )
    if reached.any():
        np.testing.assert_allclose(inside[[0, -1]], grid[reached][[0, -1]], atol=2e-3)
    elif max(ends[0]) > min(ends[1]):
        assert box.lower == box.upper and abs(box.lower - (max(ends[0]) + min(ends[1])) / 2) < 1e-12


@given(ANGLES)
def test_an_angle_is_outside_by_its_way_to_the_box(angle: float) -> None:
    box, grid = Box(np.array([-1.0, -1.0]), np.array([1.5, 1.5])), np.linspace(-1.0, 1.5, 2501)
    found = box.outside(np.array([angle, 0.0]))
    assert abs(found - np.abs(grid - angle).min()) < 1e-3


def test_only_the_rows_that_a_slack_relaxes_have_a_share_of_it() -> None:
    hard, soft = np.arange(6.0).reshape(2, 3), -np.arange(3.0).reshape(1, 3)
    whole = np.block([[hard, np.zeros((2, 1))], [soft, np.ones((1, 1))]])
    np.testing.assert_array_equal(_rows(hard, soft), whole)
