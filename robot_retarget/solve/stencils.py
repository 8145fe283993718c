"""Costs that join several frames: at one frame, its neighbours are constant."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.rows import Past
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.solve.compiled import Compiled
from robot_retarget.solve.targets import EdgeTargets

Terms = tuple[float, Floats, Floats]
"""A cost, half its gradient (nv,) and its normal matrix (nv, nv)."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The frames around one, by their offset from it; frames outside the clip are absent."""

    poses: Mapping[int, Floats]
    """(nq,) configurations of other frames."""
    targets: Mapping[int, EdgeTargets]
    """Of this frame, 0, and of others."""
    seconds: float
    """Time since the frame before [s]."""

    @property
    def past(self) -> Past | None:
        """The frame before."""
        return Past(self.poses[-1], self.seconds) if -1 in self.poses else None


class StencilCost:
    """A track of symbolic costs that join several frames."""

    track: Track
    columns: slice

    def __init__(self, robot: Robot, match: Match, track: Track, columns: slice):
        """Compile the measure of a track whose targets have the given columns."""
        self.track, self.columns = track, columns
        body = SymbolicRobot(robot, match, track.stencil)
        value, slopes = body.joined(track.kind.measure(track, body))
        symbols = [body.at(offset).bodies.q for offset in track.stencil]
        self._measure = Compiled(ca.Function("stencil", symbols, [ca.densify(each) for each in (value, *slopes)]))

    @property
    def offsets(self) -> set[int]:
        """The frames, relative to one, that share an edge with it."""
        return {a - b for a in self.track.stencil for b in self.track.stencil} - {0}

    def values(self, qpos: Floats) -> Floats:
        """Return (T, E) measures at configurations (T, nq); at the ends of the clip, its first or last frame repeats."""
        return np.array([self.value(qpos, t) for t in range(len(qpos))])

    def value(self, qpos: Floats, t: int) -> Floats:
        """Return (E,) measures at one of the configurations."""
        return self._measure(*(qpos[min(max(t + offset, 0), len(qpos) - 1)] for offset in self.track.stencil))[0]

    def terms(self, q: Floats, around: Neighbours) -> Iterator[Terms]:
        """Yield the terms of the edges that join a frame at q (nq,) with its neighbours, by their derivative at q."""
        poses = {0: q, **around.poses}
        for place, own in enumerate(self.track.stencil):
            frames = [offset - own for offset in self.track.stencil]
            if -own in around.targets and all(frame in poses for frame in frames):
                values, *slopes = self._measure(*(poses[frame] for frame in frames))
                slope = slopes[place].reshape(len(values), -1)
                yield terms(self.track, values, slope, around.targets[-own], self.columns)


def terms(
    track: Track,
    values: Floats,
    slope: Floats,
    targets: EdgeTargets,
    columns: slice,
    edges: slice | np.ndarray = slice(None),
) -> Terms:
    """Return Σ π ϱ(e) of rows of a track, its half gradient and normal matrix, by reweighted least squares.

    Args:
        track: gives scales and the Huber scale.
        values: (R,) measures.
        slope: (R, nv) their Jacobian.
        targets: of one frame.
        columns: the edges of the track in the targets.
        edges: (R,) the edge of every row.
    """
    lower, upper, priority = (side[columns][edges] for side in (targets.lower, targets.upper, targets.priority))
    residual, weight = values - np.clip(values, lower, upper), priority / track.scale[edges] ** 2
    if np.isinf(track.huber_delta):
        cost = float(weight @ residual**2)
    else:
        root = np.sqrt(1 + (residual / (track.scale[edges] * track.huber_delta)) ** 2)
        cost, weight = float(2 * track.huber_delta**2 * priority @ (root - 1)), weight / root
    weighted = weight[:, None] * slope
    return cost, weighted.T @ residual, slope.T @ weighted
