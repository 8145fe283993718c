"""A clip of any length, solved piece by piece: memory is that of one piece, time grows with the number of frames.

Windows are those of the whole clip (`windows.py`). A piece describes and solves a few of them. It passes the
configurations that the next window keeps to the next piece, so pieces join as windows do.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MatchError
from robot_retarget.graph.describe import at_rate, graph_of
from robot_retarget.graph.weights import Weights
from robot_retarget.human.features import HumanFeatures, features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.robot import Robot
from robot_retarget.scores.plausibility import mismatch
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.solve import solve_graph, trajectory_of
from robot_retarget.solver.windows import ClipPiece, FrameWindow
from robot_retarget.trajectory import Trajectory

PIECE = 6
"""Number of windows of a piece."""


def solve_long(
    motion: Motion,
    robot: Robot,
    *,
    fps: float | None = None,
    overrides: str | Path | None = None,
    weights: Weights | None = None,
    smoothing: Smoothing | None = None,
) -> Trajectory:
    """Return the trajectory of `retarget` without balance, in the memory of one piece.

    Either piece places the footholds of a stance that spans two pieces. There the result may differ from `retarget` by
    as much as a foothold may.

    Raises:
        MatchError: as `retarget`.
        UsageError: fps out of range.
    """
    motion, smoothly = at_rate(motion, fps), smoothing or Smoothing()
    human = features_of(motion, match(motion, robot, overrides))
    windows = tuple(smoothly.windows.cut(len(motion), motion.fps))
    qpos, done = np.empty((len(motion), robot.model.nq)), 0
    for own in _pieces(windows):
        first, last, fixed = own[0].first, own[-1].last, own[0].fixed
        piece = human.at(slice(first, last))
        graph = graph_of(motion.frames(first, last), piece, robot, weights or Weights()).unbalanced()
        origin = _origin(human, first)
        known = _moved(qpos[done - fixed : done], robot, -origin)
        part = ClipPiece(tuple(window.after(first) for window in own), tuple(known))
        solved = solve_graph(graph, smoothing=smoothly, part=part).trajectory.qpos
        qpos[done : own[-1].final] = _moved(solved, robot, origin)
        done = own[-1].final
    if overrides is None and (doubt := mismatch(human, robot, qpos, motion.source)):
        raise MatchError(doubt)
    return trajectory_of(motion, robot, qpos)


def _pieces(windows: tuple[FrameWindow, ...]) -> Iterator[tuple[FrameWindow, ...]]:
    for first in range(0, len(windows), PIECE):
        yield windows[first : first + PIECE]


def _origin(human: HumanFeatures, first: int) -> Floats:
    """Return (2,) the start of a piece's path on the clip's path [m]; each path starts above its own origin."""
    match = human.calibration.match
    column = match.index("pelvis") if "pelvis" in match.keypoints else slice(None)
    start, begun = (human.positions[t, column].reshape(-1, 3).mean(axis=0) for t in (0, first))
    return (begun - start)[:2] * match.leg_ratio


def _moved(qpos: Floats, robot: Robot, way: Floats) -> Floats:
    """Return configurations (T, nq) moved along the floor by (2,) [m]; a robot with a fixed root stays."""
    moved = qpos.copy()
    if robot.floating:
        moved[:, robot.root_address : robot.root_address + 2] += way
    return moved
