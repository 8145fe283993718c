"""Near: a hand within reach of a body goes where the human's goes in the frame of the body; π falls with the distance.

The hand approaches and leaves a body of another size as the human does: the point of the surface nearest to it has the size
of the body, the way from there to the hand that of the robot.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.graph.kind import AXES, Kind, RetargetContext, Track, exact
from robot_retarget.graph.symbolic_robot import SymbolicRobot


@dataclass(frozen=True)
class NearKind(Kind):
    """Coordinates of the hands [m]."""

    name: str = "near"
    whole = True
    priority: float = 20.0
    """π at the surface, over the squared leg [-]: several times that of the path."""
    reach: float = 0.3
    """π falls to 1/e at this distance of the human's hand, over the leg [-]."""

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
