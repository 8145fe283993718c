"""A test lean before a motion: the robot leans a little to its right and ahead, and its sensor must measure that.

    q(t) = q₀ + L s(t) θ,      L from δq_legs = −J_legs⁺ J_root δroot        the feet stay, the root body turns about its origin

A sensor that is turned, has a wrong sign or exchanged axes measures another lean than the model predicts.
"""

import numpy as np

from robot_retarget.actuators.feedback.reading import Reading, tilt_of
from robot_retarget.base.arrays import Floats, minimum_jerk

LEAN = 0.06
"""Lean of the trunk [rad]: 3.4°, 30 times the error of a mean over `HELD` with the data sheet's noise."""
RISE = 0.5
"""Duration of a lean, and of the way back [s]: the fastest turn is 0.23 rad/s."""
REST = 0.5
"""The first pose is held for this time before: an emulated robot is released after 0.3 s at rest [s]."""
HELD = 0.2
"""A lean is held for this time, in which the accelerometer is averaged [s]."""
PART = 0.5
"""A lean is measured from this part of it on; more about the other axis is a fault. Fewer readings than this are silence."""
LATE = 0.12
"""Readings later than this after the goals plus the sensor's own delay are a fault [s]: servos lag by 0.05 to 0.07 s."""
LONGEST_LAG = 0.3
"""Lags up to this are looked for [s]."""
AXES = ("roll", "pitch")


class LeanTest:
    """Goals of a test lean, and a check of the readings.

    Args:
        first: (n,) the first pose [rad].
        lean: (n, 2) change of the joints per roll and pitch of the root body [-].
        rate: ticks a second [1/s].
        delay: of the sensor, as its data sheet states it [s].
    """

    def __init__(self, first: Floats, lean: Floats, rate: float, delay: float = 0.0) -> None:
        shape, self._rest = _there_and_back(rate), round(REST * rate)
        leans = np.concatenate([LEAN * shape[:, None] * lean[:, axis] for axis in range(2)])
        self.goals: Floats = first + np.concatenate([np.zeros((self._rest, len(first))), leans])
        """(N, n) goals [rad]."""
        self.possible: bool = bool(lean.any())
        """Whether the feet are known."""
        self._rate, self._top, self._delay = rate, np.flatnonzero(shape == 1.0), delay
        self._spin = LEAN * np.gradient(shape) * rate
        self._readings = np.full((len(self.goals), 2, 3), np.nan)

    def note(self, tick: int, reading: Reading | None) -> None:
        """Keep the reading of a tick."""
        if reading is not None:
            self._readings[tick] = reading

    def faults(self) -> list[str]:
        """Return the differences between the readings and the lean."""
        rest, leans = self._readings[self._rest // 2 : self._rest], self._readings[self._rest :]
        if np.isnan(rest).all() or np.isnan(leans).mean() > PART:
            return ["the inertial sensor does not answer during the test lean"]
        spin, force = np.nanmean(rest, axis=0)
        found = []
        for axis, readings in enumerate(np.split(leans, 2)):
            tilt = tilt_of(np.nanmean(readings[self._top, 1], axis=0)) - tilt_of(force)
            turned = np.nancumsum(readings[:, 0, :2] - spin[:2], axis=0)[self._top[len(self._top) // 2]] / self._rate
            found += _faults("accelerometer", axis, tilt) + _faults("gyroscope", axis, turned)
        late = self._lag(leans, spin) - self._delay
        if not found and late > LATE:
            found.append(
                f"the inertial sensor measures the test lean {late:.2f} s late: its delay is not that of [imu]"
            )
        return found

    def _lag(self, leans: Floats, spin: Floats) -> float:
        """Return the lag [s] at which the gyroscope agrees best with the planned speeds of both leans."""
        measured = np.concatenate([part[:, 0, axis] - spin[axis] for axis, part in enumerate(np.split(leans, 2))])
        planned, heard = np.tile(self._spin, 2), np.nan_to_num(measured)
        lags = range(round(LONGEST_LAG * self._rate) + 1)
        return float(np.argmax([heard[k:] @ planned[: len(planned) - k] for k in lags])) / self._rate


def _there_and_back(rate: float) -> Floats:
    """(N,) from 0 to 1 and back on minimum-jerk paths, held at the top and at the end."""
    up = minimum_jerk(np.linspace(0.0, 1.0, round(RISE * rate) + 1))
    held = round(HELD * rate)
    return np.concatenate([up, np.ones(held), up[::-1], np.zeros(held)])


def _faults(sensor: str, axis: int, measured: Floats) -> list[str]:
    """Faults of a sensor that measured a lean (2,) [rad] where one about an axis was made."""
    along, across = measured[axis] / LEAN, measured[1 - axis] / LEAN
    name, other = AXES[axis], AXES[1 - axis]
    if along < -PART:
        return [f"the {sensor} measures the test lean with the wrong sign: {name} is reversed"]
    if abs(across) > PART:
        return [f"the {sensor} measures {other} where the robot leans in {name}"]
    if along < PART:
        return [f"the {sensor} measures {LEAN * along:.3f} rad of the test lean of {LEAN:g} rad in {name}"]
    return []
