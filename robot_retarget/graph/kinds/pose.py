"""Kinds of places and directions: the path of the pelvis, directions of bones, orientations of segments."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, unit
from robot_retarget.graph.kind import (
    AXES,
    NO_LENGTH,
    FrameEdges,
    Grounding,
    Kind,
    Measures,
    PlaybackFrames,
    RetargetContext,
    Track,
    exact,
)
from robot_retarget.graph.placed_scene import RootScaling, root_scaling_of
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.human.features import HumanFeatures

# Path: the pelvis follows the human's path, scaled by the leg: three far landmarks, their linear limit.


@dataclass(frozen=True, eq=False, kw_only=True)
class _Carried(FrameEdges):
    """The pelvis, three edges."""

    root_scaling: RootScaling
    priority: float
    fall: float
    """π of the height in flight."""

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Where it should be [m], and π: in flight the height is that of free fall, which no limb changes."""
        priority = np.full((len(human), 3), self.priority)
        if human.falls is not None:
            priority[human.falls.any(axis=1), 2] = self.fall
        return self.root_scaling.path(human), priority


class PathKind(Kind):
    """The pelvis, or the first keypoint of a body without one."""

    name = "path"

    def edges(self, context: RetargetContext) -> _Carried:
        """Return the coordinates of the pelvis, with the scaled path."""
        keypoint = "pelvis" if "pelvis" in context.match.keypoints else context.match.keypoints[0]
        return _Carried(
            ends=[(keypoint, "path")] * len(AXES),
            axes=AXES,
            scale=context.leg,
            root_scaling=root_scaling_of(context.human, context.match),
            priority=context.weights.path,
            fall=context.weights.touch,
        )

    def grounded(self, track: Track, grounding: Grounding) -> Track:
        """Return the path without free fall, with the priority of the ground."""
        falls = grounding.excess[:, None] != 0.0
        return replace(grounding.lowered(track), priority=np.where(falls, track.priority[:, :1], track.priority))

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the human's height alone, scaled: knees bend as the human's do, and balance moves the pelvis over the floor.

        It is no higher than its median over the clip: where the human jumps, a foot of the robot stays on the floor.
        """
        stands = measured[self.name]
        highest = np.maximum(stands, np.median(track.lower, axis=0))
        height = frames.share * np.minimum(track.lower, highest) + (1 - frames.share) * stands
        return _at_height(track, height, frames.height)

    def stood(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the height of the standing pose alone."""
        return _at_height(track, measured[self.name], frames.upright if track.ends[0][0] == "pelvis" else 0.0)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the pelvis is [m]."""
        return body.keypoint(track.ends[0][0])


def _at_height(track: Track, height: Floats, weight: float) -> Track:
    priority = np.where([axis == "z" for axis in track.axes], weight, 0.0)
    return replace(track, lower=height, upper=height, priority=np.broadcast_to(priority, height.shape))


# Compass: directions of bones and of the hip and shoulder lines.
#
# An edge joins a keypoint to a beacon at distance R along an axis; as R grows, the difference of two such distances becomes
# the coordinate of the difference vector. With its length d it is the bone's direction  u = (x_a − x_b)/d,  three edges a bone.


@dataclass(frozen=True, eq=False, kw_only=True)
class _Lines(FrameEdges):
    """Lines between keypoints, three edges each."""

    one: Ints
    other: Ints
    priority: Floats

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Return coordinates of unit vectors, and π."""
        x = human.positions
        return unit(x.take(self.one, axis=1) - x.take(self.other, axis=1)).reshape(len(x), -1), self.priority


class CompassKind(Kind):
    """Directions of bones, as the human's."""

    name = "compass"

    def edges(self, context: RetargetContext) -> _Lines | None:
        """Return the lines, with the human's directions."""
        match, lines = context.match, list(self._lines(context))
        if not lines:
            return None
        one, other = np.array([[match.index(a), match.index(b)] for a, b, _ in lines]).T
        ends, priority = [(a, b) for a, b, _ in lines for _ in AXES], np.repeat([line[2] for line in lines], len(AXES))
        return _Lines(ends=ends, axes=AXES * len(lines), one=one, other=other, priority=priority)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """The coordinates of unit vectors, x y z of one line after the other."""
        apart = [body.keypoint(a) - body.keypoint(b) for a, b in track.ends[:: len(AXES)]]
        return ca.vertcat(*(line / ca.sqrt(ca.sumsqr(line) + 1e-12) for line in apart))

    def _lines(self, context: RetargetContext) -> Iterator[tuple[str, str, float]]:
        """Yield two keypoints and the weight of the direction from the second to the first."""
        match, w = context.match, context.weights
        for k, keypoint in enumerate(match.keypoints):
            weight = w.bones.get(keypoint.split("_")[-1], 0.0)
            if match.parents[k] >= 0 and weight and match.robot_bones[k] > NO_LENGTH:
                yield keypoint, match.keypoints[int(match.parents[k])], weight
        for part, weight in (("hip", w.hips), ("shoulder", w.shoulders)):
            if {f"l_{part}", f"r_{part}"} <= set(match.keypoints) and weight:
                yield f"l_{part}", f"r_{part}", weight


# Orientation: rotations of pelvis, chest, head, hands and feet, which joint centres do not determine.
#
# Each segment has two markers, one ahead of it and one above: their directions  R e  equal the human segment's, r.

MARKERS = ("forward", "up")
_COLUMNS = slice(0, 3, 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Markers(FrameEdges):
    """The markers of segments, three edges each."""

    priority: Floats

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Return coordinates of unit vectors, and π."""
        return human.axes[..., _COLUMNS].swapaxes(2, 3).reshape(len(human), -1), self.priority


class OrientationKind(Kind):
    """Forward and up of segments."""

    name = "orientation"

    def edges(self, context: RetargetContext) -> _Markers | None:
        """Return the markers of segments that both bodies have, with the human's directions."""
        segments, w = tuple(context.human.segments), context.weights
        if not segments:
            return None
        weight = [w.foot if segment.endswith("foot") else w.orientation for segment in segments]
        ends = [(segment, marker) for segment in segments for marker in MARKERS for _ in AXES]
        axes, priority = AXES * (len(MARKERS) * len(segments)), np.repeat(weight, len(MARKERS) * len(AXES))
        return _Markers(ends=ends, axes=axes, priority=priority)

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return a trunk that leans as the human's."""
        trunk = np.array([segment in ("pelvis", "chest") and marker == "up" for segment, marker in track.ends])
        return super().played(track, measured, frames).weighed(np.where(trunk, frames.trunk, 1.0))

    def stood(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the rotation of the pelvis in the standing pose."""
        weight = np.where([a == "pelvis" for a, _ in track.ends], frames.upright, 0.0)
        return replace(track, lower=measured[self.name], upper=measured[self.name], priority=weight[None])

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """R e, x y z of one marker after the other."""
        frames = body.match.anatomy.frames
        found = []
        for segment, marker in track.ends[:: len(AXES)]:
            own, axes = frames[segment]
            found.append(body.axis(own, axes[:, _COLUMNS][:, MARKERS.index(marker)]))
        return ca.vertcat(*found)


# Mass: the centre of mass over a spot of the support polygon; a kind that balance adds to a graph.

OVER = 3e3
"""π of the centre of mass along the floor, over the squared leg: feet come first, all else after [-]. Half and double
do not change a balanced squat of the OP3."""


class MassKind(Kind):
    """The centre of mass along the floor."""

    name = "mass"
    follows_human = False

    def track(self, spots: Floats, leg: float, priority: float = OVER) -> Track:
        """Edges to spots (T, 2) on the floor [m].

        Args:
            spots: (T, 2) [m].
            leg: length of the robot's leg [m].
            priority: π over the squared leg [-].
        """
        return exact(self, [("centre of mass", "support")] * 2, spots, priority, leg, axes=("x", "y"))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the centre of mass is along the floor [m]."""
        return body.mass()[:2]
