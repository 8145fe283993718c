"""Of drawn limbs the cheapest few are chosen that are unlike each other."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_retarget.solve.starts import UNLIKE, unlike


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 30))
def test_what_is_left_out_is_like_something_cheaper_that_was_chosen(seed: int, most: int, draws: int) -> None:
    draw = np.random.default_rng(seed)
    costs, angles = draw.uniform(size=draws), draw.uniform(-1.5, 1.5, size=(draws, 2))
    chosen = unlike(costs, angles, most)
    assert chosen[0] == costs.argmin() and len(chosen) <= most

    def like(row: int, others: list[int]) -> bool:
        return any(np.abs(angles[row] - angles[other]).max() <= UNLIKE for other in others)

    assert not any(like(row, chosen[:k]) for k, row in enumerate(chosen))
    for row in set(range(draws)) - set(chosen):
        cheaper = [other for other in chosen if costs[other] <= costs[row]]
        assert like(row, cheaper) or len(cheaper) == most
