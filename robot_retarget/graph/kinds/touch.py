"""Touch: a hand and the part it touches are as near on the robot, over the path between them."""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from robot_retarget.base.arrays import Floats
from robot_retarget.contact.touch import OTHER, touch_reach, touch_strength
from robot_retarget.graph.kind import SHORTEST, FrameTargets, Kind, RetargetContext, StreamFrame, Track
from robot_retarget.graph.kinds.posture import KeypointPairs, distances
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.weights import RAMP
from robot_retarget.human.features import HumanFeatures
from robot_retarget.human.match import path_weights


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
        strength = self._gently(track.priority, round(self.lead * context.human.fps))
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
        tau = np.maximum(path_weights(match.parents, match.robot_bones)[i, j], SHORTEST)
        reach = np.array([touch_reach(*pair, self.other) for pair in ends])
        path = match.human_paths[i, j]
        return _Touches(ends=ends, scale=tau, i=i, j=j, path=path, reach=reach)

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """d_uv."""
        return distances(track, body)

    def for_robot(self) -> "TouchKind":
        """Return the kind without touches of the trunk: a robot's hand passes its hip closely without a touch."""
        return replace(self, other=0.0)

    def _gently(self, touching: Floats, frames: int) -> Floats:
        """Return (T, C) strengths that rise and fall gradually: the maximum of the frames around, then its mean."""
        width = 2 * frames + 1
        most = maximum_filter1d(touching, width, axis=0, mode="nearest")
        return np.maximum(uniform_filter1d(most, width, axis=0, mode="nearest"), 0.0)  # a running sum may end at −1e-17
