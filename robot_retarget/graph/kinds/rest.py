"""Rest: a weak pull of every joint to the standing pose, so that joints without other targets stay there."""

from dataclasses import replace

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.kind import Kind, Phase, RetargetContext, Track, exact
from robot_retarget.graph.phase import PlaybackPhase, StandPhase
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.robot.kinematics import carrying


class RestKind(Kind):
    """Every hinge."""

    name = "rest"
    follows_human = False

    def targets(self, context: RetargetContext) -> Track | None:
        """The standing pose."""
        robot, w = context.robot, context.weights
        standing = np.clip(robot.standing()[robot.qpos_index], robot.lower, robot.upper)
        weight = np.where(_wrists(context), w.wrist, w.rest)
        target = np.broadcast_to(standing, (len(context.human), len(standing)))
        return exact(self, [(name, "standing pose") for name in robot.joint_names], target, weight)

    def renewed(self, track: Track, measured: Floats | None, phase: Phase) -> Track:
        """Return the priority of a stand there, and in a playback the stand's angles outside the human's motion."""
        if measured is None or not isinstance(phase, PlaybackPhase):
            return phase.of(track)
        if isinstance(phase, StandPhase):
            return replace(track, priority=np.full((1, len(track)), phase.standing))
        inside = phase.share >= 1
        lower, upper = (np.where(inside, bound, measured) for bound in (track.lower, track.upper))
        return replace(track, lower=lower, upper=upper, priority=track.priority + (1 - phase.share) * phase.standing)

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
