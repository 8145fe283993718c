"""The cubic spline through poses, without SciPy's module for it, which takes as long to load as a short clip to solve."""

import numpy as np
from scipy.linalg import solve_banded

from robot_retarget.arrays import Floats, Ints


def cubic_spline(knots: Floats | Ints, values: Floats, wanted: Floats | Ints) -> Floats:
    """Return the spline with two continuous derivatives through values, and a third at the second and the last but one knot.

    Its slopes s solve  h_k s_{k−1} + 2 (h_{k−1} + h_k) s_k + h_{k−1} s_{k+1} = 3 (h_k d_{k−1} + h_{k−1} d_k),  with steps h and
    mean slopes d between knots. Two or three knots give the line or the parabola through them.

    Args:
        knots: (N,) ascending times, two at least.
        values: (N, n).
        wanted: (W,) times.

    Returns:
        (W, n).
    """
    step = np.diff(knots).astype(float)
    mean = np.diff(values, axis=0) / step[:, None]
    slope = _slopes(step, mean) if len(step) > 2 else _few_slopes(step, mean)
    k = np.clip(np.searchsorted(knots, wanted, side="right") - 1, 0, len(step) - 1)
    part = (wanted - knots[k])[:, None]
    bend = (slope[k] + slope[k + 1] - 2 * mean[k]) / step[k, None]
    rise = (mean[k] - slope[k]) / step[k, None] - bend
    return values[k] + part * (slope[k] + part * (rise + part * bend / step[k, None]))


def _slopes(step: Floats, mean: Floats) -> Floats:
    """Return the slopes (N, n) at four knots or more."""
    bands, right = np.zeros((3, len(step) + 1)), np.empty((len(step) + 1, mean.shape[1]))
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = step[:-1], 2 * (step[:-1] + step[1:]), step[1:]
    right[1:-1] = 3 * (step[1:, None] * mean[:-1] + step[:-1, None] * mean[1:])
    for end, inner, (first, second), (one, two) in ((0, 0, step[:2], mean[:2]), (-1, 2, step[:-3:-1], mean[:-3:-1])):
        both = first + second
        bands[1, end], bands[inner, 1 if end == 0 else -2] = second, both
        right[end] = ((first + 2 * both) * second * one + first**2 * two) / both
    return solve_banded((1, 1), bands, right)


def _few_slopes(step: Floats, mean: Floats) -> Floats:
    """Return the slopes of the line through two knots or the parabola through three."""
    if len(step) == 1:
        return mean[[0, 0]]
    middle = (step[1] * mean[0] + step[0] * mean[1]) / step.sum()
    return np.array([2 * mean[0] - middle, middle, 2 * mean[1] - middle])
