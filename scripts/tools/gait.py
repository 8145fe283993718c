"""Level walking from published joint angles.

[Winter1991] tabulates the sagittal angles of hip, knee and ankle over a stride at natural cadence. Laid on the
mannequin's legs they say how far the hip goes over a foot that stands, and so, as that foot does not slide, how long
the step is; the knee's angle says how high the hip is, and how high the swinging foot; all three together how the
foot rolls from heel to ball. One thing is not the table's: the body travels at an even speed.

[Winter1991] D. A. Winter, The Biomechanics and Motor Control of Human Gait, 2nd ed., University of Waterloo Press.
[Perry2010]  J. Perry, J. M. Burnfield, Gait Analysis: Normal and Pathological Function, 2nd ed., SLACK.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from mannequin import BALL, BALL_HEIGHT, HEEL, SHIN, THIGH, Foot, pitched
from moves import Floats, minimum_jerk
from scipy.interpolate import CubicSpline, make_interp_spline

CYCLE = 1.2
"""Stride time [s]: with the step that comes out an easy pace, 1.14 s in [Winter1991]; half of it is whole frames."""
# Degrees every 4 % of the stride from heel strike, flexion and dorsiflexion positive [Winter1991].
HIP = [19.3, 18.5, 17.3, 15.2, 12.0, 8.5, 4.9, 1.4, -1.5, -4.1, -6.4, -8.4, -10.0]
HIP += [-11.0, -10.3, -7.0, -1.1, 5.9, 12.1, 16.5, 19.5, 21.4, 21.9, 20.8, 19.5]
KNEE = [4.0, 10.5, 17.4, 21.3, 21.2, 18.9, 15.7, 12.5, 9.9, 8.3, 7.7, 8.6, 11.5]
KNEE += [17.0, 26.0, 38.7, 52.1, 61.7, 64.9, 61.6, 53.3, 40.9, 25.4, 9.9, 1.1]
ANKLE = [0.0, -3.9, -4.0, -0.5, 3.0, 5.1, 6.1, 6.8, 7.5, 8.4, 9.2, 9.6, 8.7]
ANKLE += [4.7, -3.2, -13.1, -19.5, -18.1, -12.0, -6.0, -1.6, -0.1, -0.4, -0.3, 1.0]

FLAT = -5.0
"""The pitch at which these angles leave the foot in mid-stance, where its sole is flat [deg]."""
SLACK, SOFTNESS = 1.6, 3.0
"""Pitches this near to flat count as flat, and how softly it begins beyond [deg]."""
DOUBLE_SUPPORT, TOE_OFF, TOES_STRAIGHT = 0.10, 0.56, 0.82
"""When the weight is on the new foot, when the ball leaves the ground, and when the toes are in line with the foot
again, in parts of the stride."""
SWING = (0.62, 0.69, 0.76, 0.83, 0.90, 0.95)
"""Where the swinging foot's height is the one of the knee's angle."""
LONGEST = THIGH + SHIN - 0.0015
"""A swinging leg from hip to ankle, its knee not quite straight [m]."""
STOOP = 0.003
"""How much lower the hips travel than the angles hold them, lest a knee locks where height and travel were smoothed [m]."""
SAMPLES = 400


@dataclass(frozen=True)
class Stride:
    """Steady walking as functions of a leg's phase in strides, a whole number at each of its heel strikes."""

    length: float
    """[m]"""
    _hip: CubicSpline
    """x against the steady travel, and height, of the hips [m]; periodic."""
    _ankle: CubicSpline
    """The same of the leg's ankle."""

    def hips(self, phase: Floats) -> tuple[Floats, Floats]:
        """Where the middle of the hip joints is in the sagittal plane, x and z (T,) [m]."""
        x, z = self._hip(phase % 1).T
        return x + self.length * phase, z

    def foot(self, phase: Floats, y: float) -> Foot:
        """What the leg's foot does; it is flat at x = 0 in the stride from phase 0."""
        x, z = self._ankle(phase % 1).T
        pitch = foot_pitch(phase)
        ankle = np.stack([x + self.length * phase, np.full_like(x, y), z], axis=-1)
        return Foot(ankle, pitch, toe_pitch(phase, pitch))


def arm_swing(phase: Floats) -> tuple[Floats, Floats]:
    """The flexion of a shoulder and of its elbow, of the phase of the leg on its side [rad].

    Round numbers of [Perry2010]: the shoulder goes from 24° behind at heel strike to 8° before half a stride later.
    """
    shoulder = -8 - 16 * np.cos(2 * np.pi * phase)
    elbow = 33 - 12 * np.cos(2 * np.pi * (phase - 0.05))
    return np.radians(shoulder), np.radians(elbow)


def curve(degrees: list[float], phase: Floats) -> Floats:
    """A tabulated angle at any phase, smooth and periodic [rad]."""
    knots = np.linspace(0, 1, len(degrees) + 1)
    return np.radians(CubicSpline(knots, [*degrees, degrees[0]], bc_type="periodic")(phase % 1))


def foot_pitch(phase: Floats) -> Floats:
    """The pitch of the sole, toes up positive: flat exactly while the whole sole stands [rad]."""
    raw = np.degrees(curve(HIP, phase) - curve(KNEE, phase) + curve(ANKLE, phase)) - FLAT
    excess = np.maximum(np.abs(raw) - SLACK, 0)
    return np.radians(np.sign(raw) * excess**3 / (excess**2 + SOFTNESS**2))


def toe_pitch(phase: Floats, pitch: Floats) -> Floats:
    """The pitch of the toes: flat on the ground until toe-off, then again in line with the foot [rad]."""
    lifted = minimum_jerk((phase % 1 - TOE_OFF) / (TOES_STRAIGHT - TOE_OFF))
    standing = np.where(phase % 1 < TOE_OFF, np.minimum(pitch, 0), pitch)
    return pitch + (lifted - 1) * standing


@cache
def steady() -> Stride:
    """The stride in which no standing foot slides.

    Half its length is how far apart the angles put the two feet that stand under one hip.
    """
    phase = np.linspace(0, 1, SAMPLES, endpoint=False)
    over, rolled = _hip_over_ankle(phase), _ankle_over_ground(phase)
    carried = over + rolled
    length = 2 * float(np.mean(_both(carried[:, 0])[phase < DOUBLE_SUPPORT] @ [-1, 1]))
    lag = carried[:, 0] - length * phase
    middle = float(lag[0] + lag[SAMPLES // 2]) / 2
    held = rolled[:, 1] + _rise(over, middle + length * phase - rolled[:, 0])
    height = _smoothed(phase, np.sum(_load(phase) * _both(held), axis=1))
    hip = np.stack([np.full(SAMPLES, middle), height], axis=-1)
    return Stride(length, _periodic(phase, hip), _periodic(phase, _ankle_path(phase, hip, over, rolled, length)))


def _both(left: Floats) -> Floats:
    """A quantity of a leg over its own phase, for both legs over the left one's, (T, 2): left, right."""
    return np.stack([left, np.roll(left, -SAMPLES // 2)], axis=-1)


def _load(phase: Floats) -> Floats:
    """The share of the weight that each foot carries, (T, 2): it changes over in double support."""
    left = minimum_jerk(phase / DOUBLE_SUPPORT) - minimum_jerk((phase - 0.5) / DOUBLE_SUPPORT)
    return np.stack([left, 1 - left], axis=-1)


def _hip_over_ankle(phase: Floats) -> Floats:
    """The hip against the ankle in the sagittal plane, (T, 2) [m]."""
    thigh, shin = curve(HIP, phase), curve(HIP, phase) - curve(KNEE, phase)
    return np.stack(
        [-THIGH * np.sin(thigh) - SHIN * np.sin(shin), THIGH * np.cos(thigh) + SHIN * np.cos(shin)], axis=-1
    )


def _ankle_over_ground(phase: Floats) -> Floats:
    """The ankle of a standing foot that rolls about heel or ball, (T, 2), x = 0 where it stands flat [m]."""
    pitch = foot_pitch(phase)
    about_heel = [HEEL[0], 0.0] - pitched(HEEL, pitch)[:, ::2]
    about_ball = [BALL[0], BALL_HEIGHT] - pitched(BALL, pitch)[:, ::2]
    return np.where((pitch > 0)[:, None], about_heel, about_ball)


def _smoothed(phase: Floats, height: Floats) -> Floats:
    """The part of a height that repeats every step, in its first two waves."""
    turns = [2 * np.pi * times * phase for times in (2, 4)]
    waves = np.stack([np.ones(SAMPLES), *map(np.cos, turns), *map(np.sin, turns)], axis=-1)
    return np.asarray(waves @ np.linalg.lstsq(waves, height)[0], dtype=float) - STOOP


def _rise(over: Floats, ahead: Floats) -> Floats:
    """How far the hip is above the ankle, of a leg as long as its knee's angle makes it and so far ahead [m]."""
    return np.sqrt(np.maximum(np.sum(over**2, axis=1) - ahead**2, 0))


def _ankle_path(phase: Floats, hip: Floats, over: Floats, rolled: Floats, length: float) -> Floats:
    """The ankle over a stride, x without travel: planted until toe-off, then swung through as the knee bends."""
    forth = _swung(phase, rolled[:, 0], length, {}) - length * phase
    bent = over * np.minimum(1, LONGEST / np.linalg.norm(over, axis=1, keepdims=True))
    hung = hip[:, 1] - _rise(bent, hip[:, 0] - forth)
    up = _swung(phase, rolled[:, 1], 0.0, {at: float(np.interp(at, phase, hung)) for at in SWING})
    return np.stack([forth, up], axis=-1)


def _swung(phase: Floats, planted: Floats, gain: float, through: dict[float, float]) -> Floats:
    """What holds of a planted foot until toe-off, then a quintic spline to the next heel strike, higher by `gain`."""
    stands = phase <= TOE_OFF
    spline = CubicSpline(phase[stands], planted[stands])
    ends = [[(order, float(spline(at, order))) for order in (1, 2)] for at in (TOE_OFF, 0.0)]
    values = [spline(TOE_OFF), *through.values(), spline(0.0) + gain]
    swing = make_interp_spline([TOE_OFF, *through, 1.0], values, k=5, bc_type=tuple(ends))
    return np.where(stands, planted, swing(np.maximum(phase, TOE_OFF)))


def _periodic(phase: Floats, values: Floats) -> CubicSpline:
    return CubicSpline([*phase, 1.0], np.concatenate([values, values[:1]]), bc_type="periodic")
