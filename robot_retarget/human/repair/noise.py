"""White noise of a measurement, and a low pass that takes it away.

Differences of fifth order suppress the motion of a body and leave the noise: of white noise with deviation σ they have
the deviation σ √252. It is measured where the body is quietest, for there noise remains and motion does not; that the
quietest stretches of white noise have less of it than most is allowed for (χ² of the differences that are independent).
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.special import gammaincinv

from robot_retarget.base.arrays import Floats, unit
from robot_retarget.human.capture import Capture
from robot_retarget.human.kinematics import backward, forward

ORDER = 5
_GAIN = float(np.sqrt(comb(2 * ORDER, ORDER)))
_ALIKE = sum(comb(2 * ORDER, ORDER + k) ** 2 for k in range(-ORDER, ORDER + 1)) / comb(2 * ORDER, ORDER) ** 2
"""Number of neighbouring differences of white noise that equals one independent difference."""


@dataclass(frozen=True)
class NoiseRule:
    """Thresholds of the noise measure, and the low pass."""

    most: float = 0.0025
    """Largest deviation of a coordinate that is treated as motion [m]; clean captures have up to 0.002."""
    window: float = 0.25
    """Stretches in which it is measured [s]."""
    quiet: float = 0.1
    """The quietest share of them counts."""
    lowest_rate: float = 20.0
    """At lower frame rates motion is as quick as noise [1/s]."""
    cutoff: float = 6.0
    """Of the low pass [Hz], as is usual for measured human motion [Winter2009]."""


def noise_of(points: Floats, fps: float, rule: NoiseRule) -> float:
    """Deviation σ of the noise in points (T, K, 3), of the median point; 0 where it cannot be measured.

    Args:
        points: (T, K, 3) [m].
        fps: frames per second [1/s].
    """
    window = round(rule.window * fps)
    if len(points) < window + ORDER or fps < rule.lowest_rate:
        return 0.0
    power = (np.diff(points, ORDER, axis=0) ** 2).mean(axis=2)
    stretches = power[: len(power) // window * window].reshape(-1, window, points.shape[1]).mean(axis=1)
    freedom, count = 3 * window / _ALIKE, len(stretches)
    quietest = 2 / freedom * gammaincinv(freedom / 2, (rule.quiet * (count - 1) + 1) / (count + 1))
    return float(np.median(np.sqrt(np.quantile(stretches, rule.quiet, axis=0) / quietest)) / _GAIN)


def smoothed(capture: Capture, rule: NoiseRule) -> Capture:
    """The capture through a Butterworth low pass, both ways; with rotations every joint in its parent, bones kept.

    Args:
        rule: the low pass.
    """
    from scipy.signal import butter, sosfiltfilt  # takes longer to load than most clips to read

    sos = butter(2, rule.cutoff, fs=capture.fps, output="sos")

    def low(values: Floats) -> Floats:
        return np.asarray(sosfiltfilt(sos, values, axis=0), dtype=np.float64)

    if capture.rotations is None:
        return replace(capture, positions=low(capture.positions))
    parents = capture.skeleton.parents
    translations, turns = backward(parents, capture.positions, capture.rotations)
    flips = np.cumprod(np.where((turns[1:] * turns[:-1]).sum(axis=2) < 0, -1.0, 1.0), axis=0)
    turns = np.concatenate([turns[:1], turns[1:] * flips[..., None]])
    positions, rotations = forward(parents, low(translations), unit(low(turns)))
    return replace(capture, positions=positions, rotations=rotations)
