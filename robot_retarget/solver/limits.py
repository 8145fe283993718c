"""The targets of all edges side by side; ranges, speeds and weights of differences of joints, and paths within the speeds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints, as_slice
from robot_retarget.graph.track import FRAME, Form, Role, Track, ordered
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import tangent_names


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of all tracks in the order of `track.ordered`: (E,) each of one frame, (T, E) of a clip."""

    lower: Floats
    upper: Floats
    priority: Floats
    data: Floats
    """(…, D) `Track.data` of all tracks."""

    def __len__(self) -> int:
        return len(self.lower)

    def at(self, frames: Ints | int | None) -> "Targets":
        """Return the targets of one frame or some frames of a clip; None makes a clip of a frame."""
        return Targets(*(side[frames] for side in vars(self).values()))

    def differ(self, other: "Targets") -> Bools:
        """Return the frames (T,) at which an edge has another interval, priority or data."""
        sides = zip(vars(self).values(), vars(other).values(), strict=True)
        return np.any([(own != others).any(axis=1) for own, others in sides], axis=0)


def targets_of(tracks: Sequence[Track]) -> Targets:
    """Return the intervals, priorities and data of a graph's tracks side by side."""
    sides = zip(*((*track.intervals, track.priority, track.data) for track in ordered(tracks)), strict=True)
    return Targets(*(np.concatenate(side, axis=1) for side in sides))


UNBOUNDED = 1e6
"""Speed of a joint without a speed edge [rad/s]: 1e5 times that of a brisk servo."""


@dataclass(frozen=True, eq=False)
class JointBounds:
    """(…, n) each, of one frame or of all frames of a clip."""

    lower: Floats
    upper: Floats
    """Angles [rad]."""
    speed: Floats
    """Largest speed from the frame before [rad/s]."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Costs on differences of joint coordinates over a stencil, per tangent direction."""

    weight: Floats
    """(…, nv) sum of π/scale²."""
    bend: Floats
    """(…, nv) weighted mean of the targets, 0 without costs [rad, m]."""
    inertia: Floats
    """(nv,) 1/scale² of the last of them, the weight of a direction against that of a hinge; 1 without such costs [-]."""


class JointLimits:
    """Reads the rows of joint coordinates from targets."""

    def __init__(self, robot: Robot, tracks: Sequence[Track], columns: Mapping[str, slice]):
        """Find the rows of tracks whose targets have the given columns."""
        self.robot = robot
        self._bounds = [
            (track.stencil == FRAME, columns[track.name], _indices(robot.joint_names, track))
            for track in tracks
            if track.role is Role.BOUND
        ]
        names = tangent_names(robot)
        self._differences = [
            (track.stencil, columns[track.name], _indices(names, track), 1 / track.scale**2)
            for track in tracks
            if (track.role, track.kind.form) == (Role.COST, Form.JOINT)
        ]

    def bounds(self, targets: Targets) -> JointBounds:
        """Return the bounds of each hinge: the intersection of its range and of all its bound edges."""
        shape = (*targets.lower.shape[:-1], len(self.robot.joint_names))
        lower, upper, speed = np.empty(shape), np.empty(shape), np.empty(shape)
        lower[:], upper[:], speed[:] = self.robot.lower, self.robot.upper, UNBOUNDED
        for ranged, columns, hinges in self._bounds:
            low, high = targets.lower[..., columns], targets.upper[..., columns]
            if ranged:
                lower[..., hinges] = np.maximum(lower[..., hinges], low)
                upper[..., hinges] = np.minimum(upper[..., hinges], high)
            else:
                speed[..., hinges] = np.minimum(speed[..., hinges], np.minimum(-low, high))
        return JointBounds(lower, upper, speed)

    def differences(self, targets: Targets, stencil: tuple[int, ...]) -> Differences:
        """Return the costs on differences of joint coordinates over a stencil."""
        nv = self.robot.model.nv
        weight, inertia = np.zeros((*targets.lower.shape[:-1], nv)), np.ones(nv)
        pull = np.zeros_like(weight)
        for own, columns, directions, inverse in self._differences:
            if own == stencil:
                inertia[directions], each = inverse, targets.priority[..., columns] * inverse
                weight[..., directions] += each
                pull[..., directions] += each * targets.lower[..., columns]
        return Differences(weight, pull / np.where(weight > 0, weight, 1.0), inertia)


class ConstantLimits(JointLimits):
    """The limits of a stream with joint edges that do not follow the human: they have the targets of the first frame."""

    def __init__(self, robot: Robot, tracks: Sequence[Track], columns: Mapping[str, slice]):
        super().__init__(robot, tracks, columns)
        self._bounds_of: dict[tuple[int, ...], JointBounds] = {}
        self._costs_of: dict[tuple[tuple[int, ...], tuple[int, ...]], Differences] = {}
        """By the shape of the targets, and by the stencil."""

    def bounds(self, targets: Targets) -> JointBounds:
        """Return the bounds of each hinge."""
        shape = targets.lower.shape
        if shape not in self._bounds_of:
            self._bounds_of[shape] = super().bounds(targets)
        return self._bounds_of[shape]

    def differences(self, targets: Targets, stencil: tuple[int, ...]) -> Differences:
        """Return the costs on differences of joint coordinates over a stencil."""
        key = targets.lower.shape, stencil
        if key not in self._costs_of:
            self._costs_of[key] = super().differences(targets, stencil)
        return self._costs_of[key]


def _indices(names: Sequence[str], track: Track) -> Ints | slice:
    """Return the indices of the first ends of a track among names."""
    places = {name: k for k, name in enumerate(names)}
    return as_slice(np.array([places[end] for end, _ in track.ends], dtype=np.int64))


def within_speeds(angles: Floats, reach: Floats, fixed: int = 0) -> Floats:
    """Return (T, n) angles that change by at most `reach` per frame; a path that does so already stays unchanged.

    The result is halfway between the highest such path below the angles and the lowest above them: both keep the
    speeds, and so does their mean. The first `fixed` frames stay, and the frames after them are limited to angles
    within reach of them.

    Args:
        angles: (T, n) [rad].
        reach: (n,) or (T − 1, n) largest change from a frame to the next [rad].
        fixed: number of first frames that stay unchanged.
    """
    reach = np.broadcast_to(reach, (max(len(angles) - 1, 0), angles.shape[1]))
    over, under = _bounded(angles, reach, np.maximum), _bounded(angles, reach, np.minimum)
    path = (over + under) / 2
    if fixed:
        path[:fixed] = angles[:fixed]
        room = np.cumsum(reach[fixed - 1 :], axis=0)
        path[fixed:] = np.clip(path[fixed:], angles[fixed - 1] - room, angles[fixed - 1] + room)
    return path


def _bounded(angles: Floats, reach: Floats, extreme: np.ufunc) -> Floats:
    """Return the lowest path over the angles, or the highest under them, that changes by at most `reach` per frame."""
    path, way = angles.copy(), -reach if extreme is np.maximum else reach
    for t in range(1, len(path)):
        path[t] = extreme(path[t], path[t - 1] + way[t - 1])
    for t in range(len(path) - 2, -1, -1):
        path[t] = extreme(path[t], path[t + 1] + way[t])
    return path
