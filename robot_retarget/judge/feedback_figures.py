"""Figures of the balance feedback in a rollout, and a test for oscillating gains."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.judge.stepping import Rollout
from robot_retarget.judge.units import shown

ACTIVE = 0.01
"""Feedback is active where it adds more than this to a joint [rad]: half a degree."""
WINDOW = 1.0
"""Oscillations are looked for in windows of this length [s] ..."""
SLOWEST = 2.0
"""... at this frequency and above [Hz]; a lean that the robot recovers from is slower."""
SUSTAINED = 0.03
"""Amplitude of an oscillation that is refused [rad]: backlash and rounding of an XM430 excite less than a third of it."""
PURE = 0.5
"""An oscillation has at least this part of the power of its window in one frequency and its neighbours."""


class Oscillation(NamedTuple):
    """A joint whose additions swing by themselves."""

    joint: str
    frequency: float
    """[Hz]."""
    amplitude: float
    """[rad]."""


def feedback_figures(rollout: Rollout, joints: Sequence[str], until: float | None) -> dict[str, Any]:
    """How much was added and how often, up to a fall at `until` [s]; empty for open-loop playback."""
    if rollout.added is None or not len(rollout.times):
        return {}
    added = rollout.added[: len(rollout.times)]
    if until is not None:
        added = added[: max(1, int(np.searchsorted(rollout.times, until)))]
    size = np.abs(added)
    worst = int(size.max(axis=0).argmax())
    swing = oscillation(added, joints, 1 / float(np.diff(rollout.times[:2])[0])) if len(rollout.times) > 1 else None
    figures: dict[str, Any] = {
        "feedback": True,
        "feedback_max_rad": round(float(size.max()), 4),
        "feedback_max_joint": joints[worst],
        "feedback_rms_rad": round(float(np.sqrt((added**2).mean(axis=0)).max()), 4),
        "feedback_active_share": round(float((size.max(axis=1) > ACTIVE).mean()), 4),
        "feedback_stopped_s": None if rollout.stopped is None else round(rollout.stopped, 3),
    }
    if swing is not None:
        figures |= {
            "feedback_oscillation_joint": swing.joint,
            "feedback_oscillation_Hz": round(swing.frequency, 2),
            "feedback_oscillation_rad": round(swing.amplitude, 4),
        }
    return figures


def feedback_reasons(figures: Mapping[str, Any]) -> list[str]:
    """What speaks against the feedback."""
    reasons = []
    if "feedback_oscillation_joint" in figures:
        joint, frequency = figures["feedback_oscillation_joint"], figures["feedback_oscillation_Hz"]
        size = figures["feedback_oscillation_rad"]
        reasons.append(
            f"the feedback oscillates: {joint} swings by {shown(size, 'rad')} at {frequency:g} Hz; lower its gains"
        )
    if figures.get("feedback_stopped_s") is not None:
        reasons.append(f"the feedback gave up on a lean and crouched at {figures['feedback_stopped_s']:g} s")
    return reasons


def oscillation(added: Floats, joints: Sequence[str], rate: float) -> Oscillation | None:
    """The strongest sustained swing of additions (N, n) at `rate` [1/s]: in two windows in a row, at one frequency."""
    window = round(WINDOW * rate)
    found = [_swing(added[k : k + window], joints, rate) for k in range(0, len(added) - window + 1, window)]
    lasting = [min(pair, key=lambda s: s.amplitude) for pair in pairwise(found) if _same(*pair)]
    strongest = max(lasting, key=lambda s: s.amplitude, default=None)
    return strongest if strongest is not None and strongest.amplitude > SUSTAINED else None


def _same(first: Oscillation, second: Oscillation) -> bool:
    return first.joint == second.joint and abs(first.frequency - second.frequency) <= 1.0 / WINDOW


def _swing(added: Floats, joints: Sequence[str], rate: float) -> Oscillation:
    """The largest amplitude of one frequency in a window."""
    spectrum = (
        np.abs(np.fft.rfft((added - added.mean(axis=0)) * np.hanning(len(added))[:, None], axis=0)) * 4 / len(added)
    )
    frequency = np.fft.rfftfreq(len(added), 1 / rate)
    power = (spectrum**2).sum(axis=0) + 1e-12
    spectrum[frequency < SLOWEST] = 0.0
    row, column = np.unravel_index(spectrum.argmax(), spectrum.shape)
    share = (spectrum[max(row - 1, 0) : row + 2, column] ** 2).sum() / power[column]
    return Oscillation(
        joints[int(column)], float(frequency[row]), float(spectrum[row, column]) if share > PURE else 0.0
    )
