"""Plans of playback as joint angles per tick: judged goals, a plain trajectory, and minimum-jerk paths between poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_retarget.actuators.feedback import Feedback
from robot_retarget.actuators.goals import RATE
from robot_retarget.actuators.inertial import vertical_in
from robot_retarget.actuators.map import Limits, ServoMap
from robot_retarget.base.arrays import JERK_PEAK, Floats, frozen, minimum_jerk
from robot_retarget.base.errors import ServoError
from robot_retarget.trajectory import FREE_ROOT, Trajectory


@dataclass(frozen=True)
class ServoPlan:
    """Angles of the mapped joints, one row for each tick."""

    angles: Floats
    """(N, n) [rad], in the order of the map."""
    rate: float
    """Ticks a second [1/s]."""
    feedback: Feedback | None = None
    """How an inertial sensor's readings alter the rows, which are judged with it; or None."""
    motion: Floats | None = None
    """(N, n) angles that the joints should have at each tick, if the rows lead them to compensate lag and load [rad]."""
    up: Floats | None = None
    """(N, 3) planned vertical in the root body's axes; None if the root is fixed or held."""

    def __post_init__(self) -> None:
        for name in ("angles", "motion", "up"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def duration(self) -> float:
        """From the first tick to the last [s]."""
        return (len(self.angles) - 1) / self.rate

    @property
    def top_speed(self) -> float:
        """Of any joint between ticks [rad/s]."""
        return float(np.abs(np.diff(self.angles, axis=0)).max(initial=0.0)) * self.rate

    def resampled(self, rate: float) -> "ServoPlan":
        """The same path at another rate, straight between rows; its last tick is the nearest to the end."""
        times = np.minimum(np.arange(round(self.duration * rate) + 1) / rate, self.duration)
        up = None if self.up is None else _interpolated(self.up, times * self.rate)
        return ServoPlan(_interpolated(self.angles, times * self.rate), rate, up=up)

    def held(self) -> "ServoPlan":
        """Return the same for a robot whose pelvis is fixed: no feedback acts, and no lean of the trunk is a fall."""
        return replace(self, feedback=None, up=None)


def goal_plan(trajectory: Trajectory, servo_map: ServoMap) -> ServoPlan:
    """Return the judged goals of a trajectory.

    Raises:
        ServoError: it has none, or the joints are not those of the map.
    """
    if trajectory.goals is None:
        raise ServoError("the trajectory has no goals: simulate makes them")
    goals, order = trajectory.goals, _order(trajectory, servo_map)
    feedback = None if goals.feedback is None else goals.feedback.of(order)
    rows = goals.times * trajectory.fps
    motion, up = _interpolated(trajectory.angles[:, order], rows), _vertical(trajectory)
    up = None if up is None else _interpolated(up, rows)
    return ServoPlan(goals.angles[:, order], goals.rate, feedback, motion, up)


def plain_plan(trajectory: Trajectory, servo_map: ServoMap, rate: float = RATE) -> ServoPlan:
    """Return a plain trajectory at `rate` ticks a second.

    Raises:
        ServoError: the joints are not those of the map.
    """
    angles = trajectory.angles[:, _order(trajectory, servo_map)]
    return ServoPlan(angles, trajectory.fps, up=_vertical(trajectory)).resampled(rate)


def at_speed(trajectory: Trajectory, speed: float) -> Trajectory:
    """Return a trajectory at a speed factor, without goals.

    Raises:
        ServoError: the speed is out of range.
    """
    if not 0.05 <= speed <= 5:
        raise ServoError(f"--speed {speed:g} is not in 0.05…5")
    return trajectory.altered(fps=trajectory.fps * speed)


def glide(start: Floats, end: Floats, rate: float, limits: Limits) -> ServoPlan:
    """The minimum-jerk path between two poses, within the limits of an approach."""
    frames = max(2, round(approach_time(start, end, limits) * rate) + 1)
    return ServoPlan(start + minimum_jerk(np.linspace(0.0, 1.0, frames)[:, None]) * (end - start), rate)


def approach_time(start: Floats, end: Floats, limits: Limits) -> float:
    """Return the duration of an approach between two poses [s]."""
    far = float(np.abs(end - start).max(initial=0.0))
    return max(limits.approach_time, JERK_PEAK * far / min(limits.approach_speed, limits.speed))


class Course:
    """The plan that a player follows, and the branches that lead out of it."""

    def __init__(self, plan: ServoPlan, ways: Sequence[ServoPlan] = ()) -> None:
        self.plan, self._targets = plan, list(plan.angles)
        self._ways = {parting(plan, way): way for way in ways}
        self._switch = -1
        self.stopping = False
        """Whether somebody asked to stop."""

    @property
    def last(self) -> int:
        """The last row."""
        return len(self._targets) - 1

    def stop(self, row: int) -> bool:
        """Take the next branch after a row; without another one the plan continues to its own stand.

        Returns:
            Whether there is a way into a stand and none was requested before.
        """
        if self.stopping or not self._ways:
            return False
        self.stopping, ahead = True, [parts for parts in self._ways if parts > row]
        self._switch = min(ahead, default=-1)
        return True

    def remaining(self, row: int) -> float:
        """Return the time from a row to the end [s]."""
        end = len(self._ways[self._switch].angles) - 1 if self._switch >= 0 else self.last
        return (end - row) / self.plan.rate

    def reach(self, row: int) -> bool:
        """Go on to a row, in the branch from where it parts; return whether it parts here."""
        if not 0 <= self._switch <= row:
            return False
        self.plan = self._ways[self._switch]
        self._targets, self._switch = list(self.plan.angles), -1
        return True

    def target(self, row: int) -> np.ndarray:
        """Return the goals (n,) of a row [rad]: the same object at every call."""
        return self._targets[min(row, self.last)]


def parting(plan: ServoPlan, way: ServoPlan) -> int:
    """Return the first row of a branch that differs from the plan."""
    shared = min(len(plan.angles), len(way.angles))
    differ = np.flatnonzero((plan.angles[:shared] != way.angles[:shared]).any(axis=1))
    return int(differ[0]) if differ.size else shared


def _vertical(trajectory: Trajectory) -> Floats | None:
    """Return the vertical (T, 3) in the root body's axes; None for a root that is not free."""
    root = trajectory.qpos[:, : -len(trajectory.joint_names)]
    return vertical_in(root[:, 3:]) if root.shape[1] == FREE_ROOT else None


def _interpolated(angles: Floats, rows: Floats) -> Floats:
    """Return the angles at fractional rows, linear between rows and constant beyond the ends."""
    return np.stack([np.interp(rows, np.arange(len(angles)), column) for column in angles.T], axis=1)


def _order(trajectory: Trajectory, servo_map: ServoMap) -> list[int]:
    """Return the index of each joint of the map in the trajectory."""
    bare = [joint for joint in trajectory.joint_names if joint not in (*servo_map.joints, *servo_map.passive)]
    if bare:
        raise ServoError(f"the servo map does not cover {', '.join(bare)}; it has {', '.join(servo_map.joints)}")
    idle = [joint for joint in servo_map.joints if joint not in trajectory.joint_names]
    if idle:
        raise ServoError(f"the trajectory does not say what {', '.join(idle)} should do")
    return [trajectory.joint_names.index(joint) for joint in servo_map.joints]
