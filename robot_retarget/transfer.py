"""The main job in one call: match, describe by edges, solve."""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from robot_retarget.balance.balance import Balanced, balance_of, balanced
from robot_retarget.collision.warn import Warnings, warnings_of
from robot_retarget.describe.activity import activity_of, require_own_feet
from robot_retarget.describe.edges import Edges, Weights, build_edges
from robot_retarget.describe.match import Match, match
from robot_retarget.errors import MatchError, UsageError
from robot_retarget.motion import Motion
from robot_retarget.motion.resample import at_frames
from robot_retarget.robot import Robot
from robot_retarget.solve.clip import Smoothing
from robot_retarget.solve.frame import Options
from robot_retarget.solve.look import mismatch
from robot_retarget.solve.problem import Problem, build_problem
from robot_retarget.solve.progress import Progress
from robot_retarget.solve.solution import Solution
from robot_retarget.solve.solve import solve
from robot_retarget.trajectory import Trajectory

MOST_FPS = 30.0
"""Motions of a higher rate are solved at this one unless told otherwise, as reference motions are by custom [1/s]."""

PLAUSIBLE_FPS = (5.0, 120.0)
"""Rates that may be asked for besides the motion's own [1/s]: below, limbs swing unseen between frames; above, frames are
interpolated ones, which playback makes by itself."""

WORTH_COMPILING = 60
"""Clips of as many frames are worth the seconds that a C compiler takes, once per robot (`native.py`): others follow."""


@dataclass(frozen=True)
class Result:
    """What a retargeting yields."""

    solution: Solution
    match: Match
    motion: Motion
    """The motion as it was solved: cut and resampled, and where it was balanced, slowed and held as the robot's is."""
    robot: Robot
    balance: Balanced | None = None
    """How it was brought into balance, where it was."""
    doubt: str = ""
    """In what the robot does not do what the human does, where a map of the user's, or a single causal pass, was followed
    nevertheless."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What there is to say about motion, match and balance, a sentence each."""
        return (
            *((self.doubt,) if self.doubt else ()),
            *self.motion.notes,
            *self.match.notes,
            *(self.balance.notes if self.balance else ()),
        )

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
    legs: str = "follow",
    balance: str = "off",
    progress: Progress | None = None,
) -> Result:
    """Carry a human motion over to a robot.

    Args:
        fps: frames per second of the trajectory; None takes the motion's own, `MOST_FPS` at most.
        overrides: a TOML file that replaces lines of the keypoint map (`match.match`).
        weights: how much each kind of edge counts.
        options: how long the solver searches, and what it keeps.
        smoothing: how the whole clip is smoothed; `Smoothing(passes=0)` leaves the causal pass.
        legs: `follow` the human's, or `stand`: both feet stay where they are in a balanced stand.
        balance: `static` keeps the centre of mass over the planted soles, `dynamic` the zero moment point; the motion
            then begins and ends in a balanced stand and is slowed down where it has to be (`balance.paced`). `off`
            leaves it as it is; `auto` is static for robots with a `servos.toml` beside their MJCF and for legs that
            stand, else off.
        progress: called with (frames done, frames in all).

    Raises:
        MatchError: the motion is not human, or the robot no humanoid; or, without `overrides`, what was solved as a
            whole does not look like what the human does (`look.mismatch`).
        UsageError: fps out of range, an unknown choice of legs or balance, or legs that stand without balance.
        BalanceError: the motion leaves the floor, something holds the human up, or the robot has no feet to stand on.
    """
    began = time.perf_counter()
    mode = balance_of(robot, legs, balance)
    motion = _at_rate(motion, fps)
    matched = match(motion, robot, overrides)
    if mode != "off" and legs == "follow":
        require_own_feet(activity_of(motion, matched))
    edges = build_edges(motion, matched, weights)
    problem = build_problem(robot, matched, edges, weights, native=len(edges) >= WORTH_COMPILING)
    prepared = time.perf_counter() - began
    solution = solve(problem, edges, motion.fps, Path(motion.source).name, options, smoothing, progress)
    timed = replace(solution, timings={"prepare": prepared, **solution.timings})
    doubt = mismatch(motion, robot, matched, solution.trajectory.qpos)
    if doubt and overrides is None and (smoothing is None or smoothing.passes):
        raise MatchError(doubt)
    result = Result(timed, matched, motion, robot, doubt=doubt)
    return result if mode == "off" else _in_balance(result, edges, problem, legs, mode)


def _at_rate(motion: Motion, fps: float | None) -> Motion:
    """The motion at the rate asked for, else at its own or `MOST_FPS`, whichever is less."""
    if fps is None:
        return motion.resample(min(motion.fps, MOST_FPS))
    least, most = min(PLAUSIBLE_FPS[0], motion.fps), max(PLAUSIBLE_FPS[1], motion.fps)
    if not least <= fps <= most:
        raise UsageError(
            f"fps '{fps:g}' is outside {least:g} to {most:g} frames a second for a motion of {motion.fps:g}: with fewer, "
            "limbs swing unseen between frames; with more, all that is added is interpolated, as in playback"
        )
    resampled = motion.resample(fps)
    if fps <= motion.fps:
        return resampled
    told = f"At {fps:g} frames a second, those between the motion's own {motion.fps:g} are interpolated."
    return replace(resampled, notes=(*resampled.notes, told))


def _in_balance(draft: Result, edges: Edges, problem: Problem, legs: str, mode: str) -> Result:
    """The draft, brought into balance; its frames are judged by the human's at the same moment."""
    began = time.perf_counter()
    found = balanced(draft.robot, draft.match, edges.stances, draft.trajectory, legs, mode)
    frames = np.round(found.score.at).astype(int)
    solution = draft.solution
    stress = [np.abs(problem.stress(q, edges.distance[t])[0]) for q, t in zip(found.qpos, frames, strict=True)]
    source = draft.trajectory
    times = np.interp(found.score.at, np.arange(len(source)), source.source_time)
    trajectory = replace(source, qpos=found.qpos, source_time=times)
    timings = {**solution.timings, "balance": time.perf_counter() - began}
    solution = replace(
        solution,
        trajectory=trajectory,
        status=tuple(solution.status[t] for t in frames),
        cost=solution.cost[frames],
        errors=np.array(stress),
        iterations=solution.iterations[frames],
        timings=timings,
    )
    return replace(
        draft, solution=solution, motion=at_frames(draft.motion, found.score.at, draft.motion.fps), balance=found
    )
