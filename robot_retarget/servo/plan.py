"""What is to be played, as joint angles over time: the trajectory at its speed, and the soft ways to and from it."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_retarget.arrays import Floats, frozen
from robot_retarget.errors import ServoError
from robot_retarget.servo.map import Limits, ServoMap
from robot_retarget.trajectory import Trajectory, fingerprint

PEAK = 1.875
"""The top speed of a minimum-jerk path, as a multiple of its mean."""


@dataclass(frozen=True)
class Plan:
    """Angles of the mapped joints at even times."""

    angles: Floats
    """(T, n) [rad], in the order of the map."""
    rate: float
    """Frames a second, at the speed it is played."""
    loops: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles", frozen(self.angles))

    @property
    def lap(self) -> float:
        """Duration of one time through [s]."""
        return (len(self.angles) - 1) / self.rate

    @property
    def duration(self) -> float:
        """[s]."""
        return self.lap * self.loops

    @property
    def top_speed(self) -> float:
        """Of any joint between frames [rad/s]."""
        return float(np.abs(np.diff(self.angles, axis=0)).max(initial=0.0)) * self.rate

    def at(self, time: float) -> Floats:
        """(n,) angles, straight between frames [rad]."""
        inside = self.duration if time >= self.duration else time % self.lap if self.lap else 0.0
        place = min(self.lap if time >= self.duration else inside, self.lap) * self.rate
        k = min(int(place), len(self.angles) - 1)
        after = self.angles[min(k + 1, len(self.angles) - 1)]
        return self.angles[k] + (place - k) * (after - self.angles[k])

    def sampled(self, period: float) -> Floats:
        """(N, n) angles every `period` [s] from the beginning to the end: `at`, for all times at once [rad]."""
        times = period * np.arange(round(self.duration / period) + 1)
        inside = times % self.lap if self.lap else np.zeros(len(times))
        place = np.where(times >= self.duration, self.lap, inside) * self.rate
        k = np.minimum(place.astype(int), len(self.angles) - 1)
        after = np.minimum(k + 1, len(self.angles) - 1)
        return self.angles[k] + (place - k)[:, None] * (self.angles[after] - self.angles[k])


def make_plan(
    trajectory: Trajectory,
    servo_map: ServoMap,
    speed: float = 1.0,
    loops: int = 1,
    start: float = 0.0,
    stop: float | None = None,
) -> Plan:
    """The part of a trajectory from `start` to `stop` [s] for the servos of a map.

    Raises:
        ServoError: a joint of the trajectory has no servo or a servo no joint, the part is empty, or repeating it
            would jump.
    """
    bare = [joint for joint in trajectory.joint_names if joint not in (*servo_map.joints, *servo_map.passive)]
    if bare:
        raise ServoError(f"the servo map does not cover {', '.join(bare)}; it has {', '.join(servo_map.joints)}")
    idle = [joint for joint in servo_map.joints if joint not in trajectory.joint_names]
    if idle:
        raise ServoError(f"the trajectory does not say what {', '.join(idle)} should do")
    if not 0.05 <= speed <= 5:
        raise ServoError(f"--speed {speed:g} is not in 0.05…5")
    if loops < 1:
        raise ServoError(f"--loop {loops} is not 1 or more")
    end = trajectory.duration if stop is None else stop
    if not 0 <= start <= end <= trajectory.duration + 1e-9:
        raise ServoError(f"--from {start:g} --to {end:g} is no part of 0…{trajectory.duration:g} s")
    first, last = round(start * trajectory.fps), round(end * trajectory.fps)
    hinges = trajectory.qpos[:, -len(trajectory.joint_names) :]
    order = [trajectory.joint_names.index(joint) for joint in servo_map.joints]
    plan = Plan(hinges[first : last + 1, order], trajectory.fps * speed, loops)
    seam = float(np.abs(plan.angles[0] - plan.angles[-1]).max())
    if loops > 1 and seam > 0.1:
        raise ServoError(f"its end is {seam:.2f} rad from its beginning: it cannot be looped")
    return plan


def glide(start: Floats, end: Floats, rate: float, limits: Limits) -> Plan:
    """The minimum-jerk path s(u) = 10 u³ − 15 u⁴ + 6 u⁵ between two poses, within the limits of an approach."""
    far = float(np.abs(end - start).max(initial=0.0))
    frames = max(2, round(max(limits.approach_time, PEAK * far / min(limits.approach_speed, limits.speed)) * rate) + 1)
    u = np.linspace(0.0, 1.0, frames)[:, None]
    return Plan(start + (10 * u**3 - 15 * u**4 + 6 * u**5) * (end - start), rate)


def require_pass(path: str | Path, report: str | Path | None) -> bool:
    """See to it that a trajectory file was simulated and passed; whether it did as it is, not as goals that make up for lag.

    Raises:
        ServoError: there is no report, it is of another file, or its verdict is not `pass`.
    """
    where = Path(report) if report is not None else Path(path).with_name("report.json")
    try:
        content = json.loads(where.read_text(encoding="utf-8"))
        verdict, sha256 = content["verdict"], content["trajectory_sha256"]
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError):
        raise ServoError(f"no report at {where}: simulate the trajectory first, or play it --unsafe") from None
    if sha256 != fingerprint(path):
        raise ServoError(f"{where} is about another trajectory than {path}; simulate this one, or play it --unsafe")
    if verdict != "pass":
        reasons = "; ".join(map(str, content.get("reasons", ()))) or verdict
        raise ServoError(f"{path} did not pass: {reasons}")
    figures = content.get("figures")
    return not (isinstance(figures, dict) and figures.get("compensated"))
