"""Kinds of distances between keypoints: posture, near pairs, touches."""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, lengths
from robot_retarget.contact.touch import OTHER, gradual, touch_reach, touch_strength
from robot_retarget.graph.kind import (
    AXES,
    NO_LENGTH,
    FrameEdges,
    FrameTargets,
    Kind,
    RetargetContext,
    StreamFrame,
    Track,
    exact,
)
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.weights import RAMP, Weights
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import path_weights

# Posture: distances between all keypoints, over the length of the path between them [Mucherino2017].
#
#     δ_uv = τ_B ‖x_u − x_v‖ / τ_A
#
# π falls with the distance: distances describe contacts and near passes best, and directions describe free limbs.


@dataclass(frozen=True, eq=False, kw_only=True)
class KeypointPairs(FrameEdges):
    """E pairs of keypoints; their scale is the length of the robot's path between them [m]."""

    i: Ints
    j: Ints
    path: Floats
    """(E,) length of the human's path between them [m]."""

    def closeness(self, human: HumanFeatures) -> Floats:
        """Return (T, E) distances of the human over the length of the path between."""
        x = human.positions
        return lengths(x.take(self.i, axis=1) - x.take(self.j, axis=1)) / self.path


@dataclass(frozen=True, eq=False, kw_only=True)
class _Posture(KeypointPairs):
    """Pairs whose π falls with the distance."""

    weights: Weights
    share: float

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """δ [m] and π."""
        close, w = self.closeness(human), self.weights
        near = close / w.reach
        return self.scale * close, self.share * (w.far + w.near * np.exp(-near * near))


class PostureKind(Kind):
    """Every two keypoints that no bone joins."""

    name = "posture"

    def edges(self, context: RetargetContext) -> _Posture:
        """Return the pairs, with δ by the paths of both bodies."""
        match, weights = context.match, context.weights
        i, j = np.triu_indices(len(match.keypoints), 1)
        tau = path_weights(match.parents, match.robot_bones)[i, j]
        bone = (match.parents[j] == i) | (match.parents[i] == j)
        keep = (tau > NO_LENGTH) & ~bone
        i, j, tau = i[keep], j[keep], tau[keep]
        ends = [(match.keypoints[a], match.keypoints[b]) for a, b in zip(i, j, strict=True)]
        share = len(match.keypoints) / max(len(i), 1)
        pairs = {"i": i, "j": j, "path": match.human_paths[i, j]}
        return _Posture(ends=ends, scale=tau, huber_delta=weights.huber_delta, **pairs, weights=weights, share=share)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """d_uv."""
        return distances(track, body)


def distances(track: Track, body: SymbolicRobot) -> ca.SX:
    """Return d = √(‖x_a − x_b‖² + 10⁻¹²) (E,) between the ends of every edge [m], which is smooth at 0."""
    apart = ca.horzcat(*(body.keypoint(a) - body.keypoint(b) for a, b in track.ends))
    return ca.sqrt(ca.sum1(apart**2).T + 1e-12)


# Near: a hand within reach of a body goes where the human's goes in the frame of the body; π falls with the distance.
#
# The hand approaches and leaves a body of another size as the human does: the point of the surface nearest to it has the size
# of the body, the way from there to the hand that of the robot.


@dataclass(frozen=True)
class NearKind(Kind):
    """Coordinates of the hands [m]."""

    name: str = "near"
    whole = True
    priority: float = 20.0
    """π at the surface, over the squared leg [-]: several times that of the path. In the box sample the limbs of the
    OP3 are off by 8.93° with half and 10.05° with double (9.50), near distances by 0.0378 and 0.0364 (0.0375); the jerk
    is 83 and 19 rad/s³ (20)."""
    reach: float = 0.3
    """π falls to 1/e at this distance of the human's hand, over the leg [-]. In the box sample the limbs of the OP3 are off by
    7.75° with half and 9.58° with double (8.83), and the jerk is 86 and 13 rad/s³."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return the coordinates of each hand, for the body nearest to it at each frame."""
        scene, around = context.scene, context.human.around
        if scene is None or around is None:
            return None
        touches, poses = around.touches, scene.poses(len(context.human))
        hands = sorted({part for part, _ in touches.pairs if part.endswith("_hand")})
        if not hands:
            return None
        columns = [[k for k, (part, _) in enumerate(touches.pairs) if part == hand] for hand in hands]
        bodies = np.array([body for _, body in touches.pairs])
        away = scene.ratio * scene.directions(bodies, touches.offsets, poses)
        places = scene.points(bodies, touches.places, poses) + away
        target, priority = [], []
        for own in columns:
            nearest = np.array(own)[np.abs(touches.distance[:, own]).argmin(axis=1)]
            rows = np.arange(len(nearest))
            far = np.maximum(touches.distance[rows, nearest], 0.0) / (self.reach * context.match.human_leg)
            target.append(places[rows, nearest])
            priority.append(np.repeat(self.priority * np.exp(-(far**2))[:, None], len(AXES), axis=1))
        ends = [(hand, "bodies") for hand in hands for _ in AXES]
        axes = AXES * len(hands)
        return exact(self, ends, np.hstack(target), np.hstack(priority), context.leg, axes=axes)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Where the hands are [m]."""
        return ca.vertcat(*[body.keypoint(hand) for hand, _ in track.ends[:: len(AXES)]])


# Touch: a hand and the part it touches are as near on the robot, over the path between them.


@dataclass(frozen=True, eq=False, kw_only=True)
class _Touches(KeypointPairs):
    """Pairs that may touch."""

    reach: Floats

    def targets(self, human: HumanFeatures) -> tuple[Floats, Floats]:
        """Return δ [m], and the strength of each touch, 0 … 1."""
        close = self.closeness(human)
        return self.scale * close, touch_strength(close, self.reach)


@dataclass(frozen=True)
class TouchKind(Kind):
    """Pairs that may touch; π is 0 while they are apart."""

    name: str = "touch"
    other: float = OTHER
    """Closeness within which a hand touches a part that is no head, hand or knee [-]."""
    lead: float = RAMP
    """Rise time and fall time of a touch [s]."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return the normalised distance of the human, while it is that of a touch; π rises and falls gradually."""
        track = super().targets(context)
        if track is None:
            return None
        strength = gradual(track.priority, round(self.lead * context.human.fps))
        return replace(track, priority=context.weights.touch * strength)

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets | None:
        """Return the same; the strength changes no faster than over the rise time."""
        found = super().step(context, memory)
        if found is None:
            return None
        target, _, strength = found
        reach, last = context.seconds / self.lead, memory.get("strength", 0.0)
        memory["strength"] = np.minimum(np.maximum(strength, last - reach), last + reach)
        return target, target, context.weights.touch * memory["strength"]

    def edges(self, context: RetargetContext) -> _Touches | None:
        """Return the pairs, with the strength of the touch as π."""
        match = context.match
        pairs = [
            (a, b)
            for a in range(len(match.keypoints))
            for b in range(a)
            if touch_reach(match.keypoints[b], match.keypoints[a], self.other)
        ]
        if not pairs:
            return None
        i, j = np.array(pairs).T
        ends = [(match.keypoints[b], match.keypoints[a]) for a, b in pairs]
        tau = np.maximum(path_weights(match.parents, match.robot_bones)[i, j], NO_LENGTH)
        reach = np.array([touch_reach(*pair, self.other) for pair in ends])
        path = match.human_paths[i, j]
        return _Touches(ends=ends, scale=tau, i=i, j=j, path=path, reach=reach)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """d_uv."""
        return distances(track, body)

    def for_robot(self) -> "TouchKind":
        """Return the kind without touches of the trunk: a robot's hand passes its hip closely without a touch."""
        return replace(self, other=0.0)
