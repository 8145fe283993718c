"""Measure the warnings: `python scripts/bench_warn.py --robot NAME … --clips FOLDER` prints tables.

Truth is what MuJoCo says: frames in which geoms of two links overlap, less the pairs that do so where the robot rests.
The trajectories collide: clips retargeted without separation, and smooth random motions of all joints. Set
OMP_NUM_THREADS=1 to keep everything on one core.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

import robot_retarget as rr
from robot_retarget.arrays import Floats
from robot_retarget.retarget.frame import Options
from robot_retarget.retarget.warn import Surfaces, Warner, WarnOptions, Warnings, surfaces, warnings_of
from robot_retarget.robot.collidable import Clearance
from robot_retarget.trajectory import Trajectory

NEAR_MISS = 0.01
"""A warning is right when the geoms come this near [m]."""
FAR = 0.08
"""Distances are told apart up to here [m]."""
GAP = 0.15
"""Contacts of a pair that part for less than this are one [s]."""
HORIZONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0)


@dataclass(frozen=True, eq=False)
class Case:
    """A trajectory and the distances (T, P) of its links' geoms [m]."""

    kind: str
    trajectory: Trajectory
    distance: Floats


@dataclass
class Score:
    """How warnings compare with what happened."""

    contacts: int = 0
    foreseen: int = 0
    alarms: int = 0
    right: int = 0
    leads: list[float] = field(default_factory=list)

    @property
    def recall(self) -> float:
        return self.foreseen / max(self.contacts, 1)

    @property
    def precision(self) -> float:
        return self.right / max(self.alarms, 1)

    @property
    def lead(self) -> float:
        return float(np.median(self.leads)) if self.leads else 0.0


def random_motion(robot: rr.Robot, seed: int, seconds: float = 4.0, fps: float = 30.0) -> Trajectory:
    """A cubic spline through poses drawn within 60 % of the ranges, one every 0.6 … 1.2 s."""
    draw = np.random.default_rng(seed)
    pace = draw.uniform(0.6, 1.2)
    knots = np.arange(0, seconds + pace, pace)
    middle = robot.standing()[robot.qpos_index]
    low, high = (middle + np.clip(0.6 * (end - middle), -1.5, 1.5) for end in (robot.lower, robot.upper))
    times = np.arange(round(seconds * fps)) / fps
    qpos = np.tile(robot.standing(), (len(times), 1))
    path = CubicSpline(knots, draw.uniform(low, high, (len(knots), len(low))), bc_type="clamped")(times)
    qpos[:, robot.qpos_index] = np.clip(path, robot.lower, robot.upper)
    return Trajectory(qpos, fps, robot.joint_names, robot.name, f"random {seed}")


def clips_of(robot: rr.Robot, folder: Path | None) -> Iterator[Trajectory]:
    """The clips of a folder carried over without separation."""
    for path in sorted(folder.rglob("*.bvh")) if folder else ():
        yield rr.retarget(rr.read_motion(path), robot, fps=30, options=Options(separation=False)).trajectory


def stretches(what: np.ndarray, gap: int) -> list[tuple[int, int]]:
    """First and last frame of every stretch, those less than `gap` frames apart joined."""
    frames = np.flatnonzero(what)
    cuts = np.flatnonzero(np.diff(frames) > gap) + 1
    return [(int(part[0]), int(part[-1])) for part in np.split(frames, cuts) if part.size]


def judge(cases: Sequence[Case], alarms: Sequence[np.ndarray], horizon: float) -> Score:
    """Alarms (T, P) against contacts.

    A contact is foreseen when an alarm of its pair began before it and lasted to it, or to within the horizon of it.
    An alarm is right when its pair touches, or comes within `NEAR_MISS`, before the horizon after it is over. Those
    under way in a trajectory's first frames (no step is known) count for neither.
    """
    score = Score()
    for case, alarm in zip(cases, alarms, strict=True):
        fps, last = case.trajectory.fps, len(case.distance)
        ahead, gap, touch = round(horizon * fps), round(GAP * fps), case.distance <= 0
        for pair in np.flatnonzero(alarm.any(0) | touch.any(0)):
            flags = stretches(alarm[:, pair], 1)
            for first, end in flags:
                if not touch[first, pair]:
                    score.alarms += 1
                    score.right += bool((case.distance[first : min(end + ahead + 1, last), pair] <= NEAR_MISS).any())
            for start, _ in stretches(touch[:, pair], gap):
                if start >= 3:
                    before = [first for first, end in flags if first < start and end >= start - ahead]
                    score.contacts += 1
                    score.foreseen += bool(before)
                    score.leads.append((start - before[-1]) / fps if before else 0.0)
    return score


def by_distance(cases: Sequence[Case], precision: float, horizon: float) -> tuple[float, Score]:
    """The alarm by distance alone with the largest threshold that is as precise, held as long as the warnings are."""
    hold = WarnOptions().release
    best = 0.0, Score()
    for threshold in np.arange(0.002, FAR, 0.001):
        alarms = []
        for case in cases:
            near = case.distance <= threshold
            size = round(hold * case.trajectory.fps) + 1
            padded = np.concatenate([np.zeros((size - 1, near.shape[1]), bool), near])
            alarms.append(np.lib.stride_tricks.sliding_window_view(padded, size, axis=0).any(-1))
        score = judge(cases, alarms, horizon)
        if score.precision >= precision:
            best = float(threshold), score
    return best
