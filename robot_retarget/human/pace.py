"""The frame rate of a clip whose file states none, from the gait: how often people step follows from how long their steps are."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.base.errors import MatchError
from robot_retarget.human.capture import Capture
from robot_retarget.human.recognition.recognise import leg_length, recognise
from robot_retarget.human.upright import unit_of

RATES = (30.0, 60.0, 120.0)
"""Of the captures in this format [1/s]."""
WALK_RATIO = 0.0065 * 60
"""Length of a step over steps a second, which people keep at every speed [m s]: 0.0065 m over steps a minute [Sekiya1996]. Eight
walks and runs have 0.75 to 1.15 of the steps that follow from it; rates differ by 2."""
SHORTEST_STRIDE = 0.8
"""A shorter stride is no gait [leg lengths]: the slowest walks of those takes have 0.9."""
SMOOTH_WAYS = 2
"""Standard deviation of the Gaussian over ways [frames]: in five takes 1 and 2 find the same strides, and 3 loses those of a run at 30 a second."""


def rate_from_gait(capture: Capture) -> tuple[float, str] | None:
    """Return the rate of `RATES` at which the body walks or runs as bodies do, and a sentence; None without two strides.

    Args:
        capture: at any rate.
    """
    try:
        recognition = recognise(capture.skeleton, capture.positions)
    except MatchError:
        return None
    leg = leg_length(recognition, capture.positions)
    x = dict(zip(recognition.keypoints, recognition.place(capture.positions / leg).swapaxes(0, 1), strict=True))
    lengths, frames = _strides(x["pelvis"], x["l_ankle"] - x["r_ankle"])
    if len(lengths) < 2 or np.median(lengths) < SHORTEST_STRIDE:
        return None
    stride = float(np.median(lengths)) * leg * unit_of(recognition, capture.positions)[0]
    duration = float(np.median(frames))
    steps = stride / 2 / WALK_RATIO  # a second
    rate = min(RATES, key=lambda one: abs(np.log(one * 2 / duration / steps)))
    speeds = {one: f"{stride * one / duration:.1f} m/s at {one:g}" for one in RATES}
    return rate, (
        f"The file says no frame rate; {rate:g} frames per second were taken, by its strides of {stride:.2f} m: {speeds.pop(rate)}, "
        f"{' and '.join(speeds.values())}."
    )


def _strides(pelvis: Floats, apart: Floats) -> tuple[Floats, Floats]:
    """Lengths [leg lengths] and durations [frames] of the strides of a path (T, 3), from one passing of the feet to the next but one.

    Args:
        apart: (T, 3) from the right ankle to the left.
    """
    if len(pelvis) < 2:
        return np.zeros(0), np.zeros(0)
    way = unit(np.gradient(gaussian_filter1d(pelvis, SMOOTH_WAYS, axis=0), axis=0))
    ahead = gaussian_filter1d((apart * way).sum(axis=1), SMOOTH_WAYS)
    passing = np.flatnonzero(np.diff(np.signbit(ahead)))
    return np.linalg.norm(pelvis[passing[2:]] - pelvis[passing[:-2]], axis=1), (passing[2:] - passing[:-2]).astype(
        float
    )
