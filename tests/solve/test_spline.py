"""The cubic spline is SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from robot_retarget.solve.spline import cubic_spline


@pytest.mark.parametrize("count", [2, 3, 4, 5, 40])
def test_the_spline_is_that_of_scipy(count: int) -> None:
    drawn = np.random.default_rng(count)
    knots = np.cumsum(drawn.integers(1, 5, count)) - 3
    values, wanted = drawn.normal(size=(count, 7)), np.arange(knots[0], knots[-1] + 1)
    np.testing.assert_allclose(cubic_spline(knots, values, wanted), CubicSpline(knots, values)(wanted), atol=1e-12)
