"""Rest: a weak pull of every joint to the standing pose, so that joints without other targets stay there."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.kinds.kind import FRAME, PlaybackTargets, RetargetContext, Role
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import Track, exact
from robot_retarget.robot.kinematics import carrying


@dataclass(frozen=True)
class RestKind:
    """Every hinge."""

    name: str = "rest"
    role: Role = Role.COST
    stencil: tuple[int, ...] = FRAME

    def targets(self, context: RetargetContext) -> Track | None:
        """The standing pose."""
        robot, w = context.robot, context.weights
        standing = np.clip(robot.standing()[robot.qpos_index], robot.lower, robot.upper)
        weight = np.where(_wrists(context), w.wrist, w.rest)
        target = np.broadcast_to(standing, (len(context.human), len(standing)))
        return exact(self, [(name, "standing pose") for name in robot.joint_names], target, weight)

    def played(self, track: Track, stand: Floats, playback: PlaybackTargets) -> Track:
        """Return the stand's angles with a higher priority outside the human's motion."""
        inside = playback.share >= 1
        lower, upper = (np.where(inside, bound, stand) for bound in (track.lower, track.upper))
        priority = track.priority + (1 - playback.share) * playback.standing
        return replace(track, lower=lower, upper=upper, priority=priority)

    def stood(self, track: Track, measured: Floats, playback: PlaybackTargets) -> Track:
        """Return the joints' standing angles with the priority of a stand."""
        return replace(track, priority=np.full((1, len(track)), playback.standing))

    def measure(self, track: Track, body: SymbolicRobot) -> ca.SX:
        """Angles [rad]."""
        return body.angles()[[body.robot.joint_names.index(name) for name, _ in track.ends]]


def _wrists(context: RetargetContext) -> np.ndarray:
    """(n,) the wrists that no marker leads: hinges that move a hand and no other keypoint."""
    robot, match = context.robot, context.match
    bodies = match.points.bodies
    moves = carrying(robot.model)[bodies][:, robot.dof_index]
    marked = {match.anatomy.frames[segment][0] for segment in context.human.segments}
    hands = [k for k, name in enumerate(match.keypoints) if name[2:] == "hand" and int(bodies[k]) not in marked]
    return np.asarray((moves.sum(axis=0) == 1) & moves[hands].any(axis=0))
