"""Two ways in which joints may go on, and which of them has lately been right.

With v the last step of the joints and a = v − v_before its change, both over one `STEP` of time, the joints stand k
steps ahead at q + g(k) v + h(k) a. What keeps its pace (a machine's smooth path) goes by

    g(k) = k,    h(k) = τ(k − (τ − ½)(1 − exp(−k/τ))):    the change of pace is kept on and fades over τ steps;

what swings and settles (the limbs of people) goes by the steps v₊₁ = c₁ v − c₂ v_before, summed up. Every look the
two guesses made `CHECK` steps before are compared with what came; the share of the first is the other's part of the
squared errors, older ones forgotten. So a stream is foreseen as its own past suggests.
"""

from collections import deque

import numpy as np

from robot_retarget.arrays import Floats

STEP = 1 / 30
"""Time over which a step is taken [s]: whole frames, at least one."""
FADING = 8 / 30
"""The time over which a change of pace fades, τ steps [s]."""
SWING = (1.627, -0.739)
"""c₁ and −c₂, fitted to half of the captured clips of the benchmark: a swing of 0.64 s that loses 14 % in every step."""
CHECK = 6
"""Guesses are compared with what came so many steps later."""
UNKNOWN = 2
"""At the first looks no step or no change of it is known: guesses would mean nothing."""
TRUSTED = 0.8
"""With this share the stream keeps its pace: what is foreseen of it need not be confirmed."""
MEMORY = 1.0
"""Time over which old errors are forgotten [s]."""


def steady(k: Floats, step: float) -> Floats:
    """(2, K) gains g and h of what keeps its pace, `step` [s] a step."""
    fading = FADING / step
    return np.stack([k, fading * (k + (fading - 0.5) * np.expm1(-k / fading))])


def swinging(k: Floats) -> Floats:
    """(2, K) gains g and h of what swings and settles; straight between whole steps."""
    first, second = np.zeros(2), np.zeros((int(np.ceil(k.max())) + 1, 2))
    carry = np.eye(2)
    for ahead in range(1, len(second)):
        carry = np.array([SWING, (1.0, 0.0)]) @ carry
        first = first + carry[0]
        second[ahead] = first
    now, before = (np.interp(k, np.arange(len(second)), column) for column in second.T)
    return np.stack([now + before, -before])


class Pace:
    """Follows one stream, look by look."""

    def __init__(self, k: Floats, step: float):
        """Gains for the instants k (K,) in steps of `step` [s]."""
        self.ways = np.stack([steady(k, step), swinging(k)])
        self._between = self.ways[0] - self.ways[1]
        check = np.array([float(CHECK)])
        self._check = np.stack([steady(check, step), swinging(check)])[..., 0]
        self.trust = 0.5
        """The share of what keeps its pace, 0 … 1."""
        self._looks = 0
        self._guesses: deque[Floats] = deque(maxlen=CHECK + 1)
        self._error, self._keep = np.zeros(2), np.exp(-STEP / MEMORY)

    def next(self, joints: Floats, step: Floats, change: Floats) -> Floats:
        """(2, K) gains g and h for the look at joints (n,) with this step and change of step."""
        self._looks += 1
        if self._looks > UNKNOWN:
            self._guesses.append(joints + self._check[:, :1] * step + self._check[:, 1:] * change)
        if len(self._guesses) > CHECK:
            missed = self._guesses[0] - joints
            self._error = self._keep * self._error + np.einsum("wj,wj->w", missed, missed)
        steady, swinging = self._error.tolist()
        self.trust = swinging / (steady + swinging) if steady + swinging > 0 else 0.5
        return self.ways[1] + self.trust * self._between
