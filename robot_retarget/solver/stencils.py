"""Symbolic costs that join several frames: their rows at the frames, and the terms of a frame whose neighbours are constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.graph.rows import Past
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import Track
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.solver.compiled import Build
from robot_retarget.solver.limits import ClipTargets, EdgeTargets
from robot_retarget.solver.native import build_key

Terms = tuple[Floats, Floats, Floats]
"""Costs (…), halves of their gradients (…, nv) and their normal matrices (…, nv, nv)."""
Sides = tuple[Floats, Floats, Floats]
"""Lower bounds, upper bounds and priorities (…, E) of the edges of a track."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The frames around one, by their offset from it; frames outside the clip are absent."""

    poses: Mapping[int, Floats]
    """(nq,) configurations of other frames."""
    targets: Mapping[int, EdgeTargets]
    """Of this frame, 0, and of others."""
    seconds: float
    """Time since the frame before [s]."""

    alone: ClassVar[bool] = True
    """Whether a frame moves alone, and symbolic costs over several frames are its own."""

    @property
    def past(self) -> Past | None:
        """The frame before."""
        return Past(self.poses[-1], self.seconds) if -1 in self.poses else None

    def at(self, place: int) -> "Neighbours":
        """Return the frames around the only one."""
        return self

    def of(self, places: Ints) -> "Neighbours":
        """Return the frames around the only one."""
        return self

    def known(self, offset: int) -> Bools:
        """Return whether the frame at an offset is known (1,)."""
        return np.array([offset == 0 or offset in self.poses])

    def points(self, cost: "StencilCost", offset: int) -> Floats:
        """Return the points (1, S) of a cost at an offset; an unknown frame repeats another."""
        return cost.points(self.poses.get(offset, next(iter(self.poses.values())))[None])[0]

    def sides(self, offset: int, columns: slice) -> Sides:
        """Return the targets (1, E) of the frame at an offset; edges of an unknown frame are absent."""
        own = self.targets.get(offset, self.targets[0])
        there = float(offset in self.targets)
        return own.lower[None, columns], own.upper[None, columns], there * own.priority[None, columns]


@dataclass(frozen=True, eq=False)
class ClipNeighbours:
    """The frames around N frames of a clip."""

    qpos: Floats | Sequence[Floats]
    """(T, nq) configurations of the clip, or of its first frames."""
    targets: ClipTargets
    """Of its frames."""
    frames: Ints
    """(N,)."""
    offsets: tuple[int, ...]
    """The frames, relative to one, that share an edge with it."""
    seconds: float
    """Time since the frame before [s]."""
    alone: ClassVar[bool] = False
    """The smooth path of a clip has its symbolic costs over several frames, because all frames move."""
    known_points: dict["StencilCost", Floats] = field(default_factory=dict)
    """(T, S) points of the clip, once a cost asks for them."""

    def at(self, place: int) -> Neighbours:
        """Return the frames around one of the N."""
        frame = int(self.frames[place])
        near = {offset: frame + offset for offset in self.offsets if 0 <= frame + offset < len(self.qpos)}
        targets = {offset: self.targets.at(k) for offset, k in {0: frame, **near}.items()}
        return Neighbours({offset: self.qpos[k] for offset, k in near.items()}, targets, self.seconds)

    def of(self, places: Ints) -> "ClipNeighbours":
        """Return the frames around some of the N."""
        return replace(self, frames=self.frames[places])

    def known(self, offset: int) -> Bools:
        """Return whether the frames at an offset are in the clip (N,)."""
        at = self.frames + offset
        return (at >= 0) & (at < len(self.qpos))

    def points(self, cost: "StencilCost", offset: int) -> Floats:
        """Return the points (N, S) of a cost at an offset; at its ends, the first or last frame repeats."""
        if cost not in self.known_points:
            self.known_points[cost] = cost.points(np.asarray(self.qpos))[0]
        return self.known_points[cost][self._inside(offset)]

    def sides(self, offset: int, columns: slice) -> Sides:
        """Return the targets (N, E) of the frames at an offset."""
        at, own = self._inside(offset), self.targets
        return own.lower[at, columns], own.upper[at, columns], own.priority[at, columns]

    def _inside(self, offset: int) -> Ints:
        return (self.frames + offset).clip(0, len(self.qpos) - 1)


class StencilCost:
    """A track of symbolic costs that join several frames.

    One call evaluates all frames: every edge that joins a frame with others, and its slopes by this frame, from the frame's
    configuration and the points of the others.
    """

    track: Track
    columns: slice
    offsets: tuple[int, ...]
    """The frames, relative to one, that share an edge with it."""
    build: Build

    def __init__(self, robot: Robot, match: Match, track: Track, columns: slice, native: bool = False):
        """Compile the measure of a track whose targets have the given columns."""
        self.track, self.columns, self.offsets = track, columns, _offsets(track.stencil)
        key = build_key(robot, match, [track]) if native else None
        self.build = Build(lambda: _functions(robot, match, track), key)
        self.points, self._values, self._slopes = self.build.functions
        self.nv = robot.model.nv

    def values(self, qpos: Floats) -> Floats:
        """Return (T, E) measures at configurations (T, nq); at the ends of the clip, its first or last frame repeats."""
        (points,), frames, last = self.points(qpos), np.arange(len(qpos)), len(qpos) - 1
        return self._values(*(points[(frames + offset).clip(0, last)] for offset in self.track.stencil))[0]

    def rows(self, q: Floats, around: Neighbours | ClipNeighbours) -> tuple[Floats, Floats]:
        """Return measures (N, P E) and slopes (N, P E, nv) of the edges in which frames have each of the P places of the stencil.

        Args:
            q: (N, nq) the frames, by which the slopes are.
            around: the other frames.
        """
        values, slopes = self._slopes(q, *(around.points(self, offset) for offset in self.offsets))
        return values, slopes

    def sides(self, around: Neighbours | ClipNeighbours, own: int) -> Sides:
        """Return the targets (N, E) of the edges in which frames have a place of the stencil.

        Edges with a frame outside the clip are absent.
        """
        lower, upper, priority = around.sides(-own, self.columns)
        known = np.logical_and.reduce([around.known(offset - own) for offset in self.track.stencil])
        return lower, upper, known[:, None] * priority

    def terms(self, q: Floats, around: Neighbours | ClipNeighbours) -> Terms:
        """Return the terms of the edges that join frames at q (N, nq) with their neighbours, by their derivative at q."""
        by_place = zip(*(self.sides(around, own) for own in self.track.stencil), strict=True)
        lower, upper, priority = (np.concatenate(side, axis=1) for side in by_place)
        if not priority.any():
            return np.zeros(len(q)), np.zeros((len(q), self.nv)), np.zeros((len(q), self.nv, self.nv))
        values, slope = self.rows(q, around)
        edges = np.tile(np.arange(len(self.track)), len(self.track.stencil))
        return terms(self.track, values, slope, (lower, upper, priority), edges)


def _offsets(stencil: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sorted({a - b for a in stencil for b in stencil} - {0}))


def _functions(robot: Robot, match: Match, track: Track) -> list[ca.Function]:
    """Return the functions of a track.

    q ↦ points (S); points of the frames of the stencil ↦ measure (E); q and points of the frames around it ↦ measures (P E)
    of the edges in which it has each of the P places of the stencil, and their slopes (P E, nv) by it.
    """
    body = SymbolicRobot(robot, match, track.stencil)
    found, q = body.joined(track.kind.measure(track, body)), body.bodies.q
    measure = ca.Function("values", found.points, [ca.densify(found.value)])
    by_points = ca.Function("by_points", found.points, [ca.jacobian(found.value, own) for own in found.points])
    around = {offset: ca.SX.sym("points", found.places.numel()) for offset in _offsets(track.stencil)}
    values, slopes = [], []
    for place, own in enumerate(track.stencil):
        points = [around.get(offset - own, found.places) for offset in track.stencil]
        values.append(measure(*points))
        slopes.append(by_points.call(points)[place] @ found.travels)
    joined = [ca.densify(ca.vertcat(*values)), ca.densify(ca.vertcat(*slopes))]
    points = ca.Function("points", [q], [ca.densify(found.places)])
    return [points, measure, ca.Function("slopes", [q, *around.values()], joined)]


def terms(track: Track, values: Floats, slope: Floats, sides: Sides, edges: slice | np.ndarray = slice(None)) -> Terms:
    """Return Σ π ϱ(e) of rows of a track, its half gradient and normal matrix, by reweighted least squares.

    Args:
        track: gives scales and the Huber scale.
        values: (…, R) measures.
        slope: (…, R, nv) their Jacobian.
        sides: (…, R) targets of the rows.
        edges: (R,) the edge of every row.
    """
    cost, residual, weight = weighted(track, values, sides, edges)
    columns = slope.swapaxes(-1, -2)
    return cost.sum(axis=-1), (columns @ (weight * residual)[..., None])[..., 0], columns @ (weight[..., None] * slope)


def weighted(
    track: Track, values: Floats, sides: Sides, edges: slice | np.ndarray = slice(None)
) -> tuple[Floats, Floats, Floats]:
    """Return π ϱ(e), the residuals and their weights (…, R) of rows of a track; arguments as in `terms`."""
    (lower, upper, priority), scale = sides, track.scale[edges]
    residual = values - np.clip(values, lower, upper)
    weight = np.where((values > lower) & (values < upper), 0.0, priority / scale**2)
    if np.isinf(track.huber_delta):
        return weight * residual**2, residual, weight
    root = np.sqrt(1 + (residual / (scale * track.huber_delta)) ** 2)
    return 2 * track.huber_delta**2 * priority * (root - 1), residual, weight / root
