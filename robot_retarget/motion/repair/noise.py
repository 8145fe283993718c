"""White noise of a measurement, and a low pass that takes it away.

Differences of fifth order pass over what a body does and leave the noise: of white noise with deviation σ they have
the deviation σ √252. It is measured where the body is quietest, for there noise remains and motion does not.
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from scipy.signal import butter, sosfiltfilt

from robot_retarget.arrays import Floats, unit
from robot_retarget.motion.capture import Capture
from robot_retarget.motion.kinematics import backward, forward

ORDER = 5
_GAIN = float(np.sqrt(sum(comb(ORDER, k) ** 2 for k in range(ORDER + 1))))


@dataclass(frozen=True)
class NoiseRule:
    """What is noise, and what is done about it."""

    most: float = 0.002
    """Deviation of a coordinate that is still taken for motion [m]; clean captures have up to 0.0015."""
    window: float = 0.5
    """Stretches in which it is measured [s]."""
    quiet: float = 0.2
    """The quietest share of them counts."""
    shortest: float = 2.0
    """Clips shorter than this have no quiet stretch [s]."""
    lowest_rate: float = 20.0
    """At lower frame rates motion is as quick as noise [1/s]."""
    cutoff: float = 6.0
    """Of the low pass [Hz], as is usual for measured human motion [Winter2009]."""


def noise_of(points: Floats, fps: float, rule: NoiseRule) -> float:
    """Deviation σ of the noise in points (T, K, 3), of the median point; 0 where it cannot be measured."""
    window = round(rule.window * fps)
    if len(points) < max(rule.shortest, rule.window) * fps + ORDER or fps < rule.lowest_rate:
        return 0.0
    power = (np.diff(points, ORDER, axis=0) ** 2).mean(axis=2)
    stretches = power[: len(power) // window * window].reshape(-1, window, points.shape[1])
    deviation = np.sqrt(stretches.mean(axis=1)) / _GAIN
    return float(np.median(np.quantile(deviation, rule.quiet, axis=0)))


def smoothed(capture: Capture, rule: NoiseRule) -> Capture:
    """The capture through a Butterworth low pass, both ways; with rotations every joint in its parent, bones kept."""
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
