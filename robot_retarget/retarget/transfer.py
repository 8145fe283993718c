"""The main job in one call: match, describe by edges, solve."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from robot_retarget.motion import Motion
from robot_retarget.retarget.edges import Weights, build_edges
from robot_retarget.retarget.frame import Options
from robot_retarget.retarget.match import Match, match
from robot_retarget.retarget.problem import build_problem
from robot_retarget.retarget.solution import Solution
from robot_retarget.retarget.solve import Progress, Smoothing, solve
from robot_retarget.retarget.warn import Warnings, warnings_of
from robot_retarget.robot import Robot
from robot_retarget.trajectory import Trajectory

MOST_FPS = 30.0
"""Motions of a higher rate are solved at this one unless told otherwise, as reference motions are by custom [1/s]."""


@dataclass(frozen=True)
class Result:
    """What a retargeting yields."""

    solution: Solution
    match: Match
    motion: Motion
    """The motion as it was solved: cut and resampled."""
    robot: Robot

    @property
    def trajectory(self) -> Trajectory:
        """The robot's configurations over time."""
        return self.solution.trajectory

    @cached_property
    def warnings(self) -> Warnings:
        """Self-collisions foreseen along the trajectory; looked for when first asked.

        Raises:
            TrajectoryError: a single frame has no next one.
        """
        return warnings_of(self.trajectory, self.robot)


def retarget(
    motion: Motion,
    robot: Robot,
    *,
    fps: float | None = None,
    overrides: str | Path | None = None,
    weights: Weights | None = None,
    options: Options | None = None,
    smoothing: Smoothing | None = None,
    progress: Progress | None = None,
) -> Result:
    """Carry a human motion over to a robot.

    Args:
        fps: frames per second of the trajectory; None takes the motion's own, `MOST_FPS` at most.
        overrides: a TOML file that replaces lines of the keypoint map (`match.match`).
        weights: how much each kind of edge counts.
        options: how long the solver searches, and what it keeps.
        smoothing: how the whole clip is smoothed; `Smoothing(passes=0)` leaves the causal pass.
        progress: called with (frames done, frames in all).

    Raises:
        MatchError: the motion is not human, or the robot no humanoid.
        UsageError: fps out of range.
    """
    began = time.perf_counter()
    motion = motion.resample(min(motion.fps, MOST_FPS) if fps is None else fps)
    matched = match(motion, robot, overrides)
    edges = build_edges(motion, matched, weights)
    problem = build_problem(robot, matched, edges, weights)
    prepared = time.perf_counter() - began
    solution = solve(problem, edges, motion.fps, Path(motion.source).name, options, smoothing, progress)
    timed = replace(solution, timings={"prepare": prepared, **solution.timings})
    return Result(timed, matched, motion, robot)
