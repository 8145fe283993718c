"""Kinds of joint coordinates: ranges and speeds, the standing pose, couplings, smoothness and inertia."""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.base.arrays import Bools, Floats, intervals
from robot_retarget.graph.kind import (
    Form,
    FrameTargets,
    Grounding,
    Kind,
    MeasureRows,
    Measures,
    PlaybackFrames,
    RetargetContext,
    Role,
    RowState,
    StreamFrame,
    Track,
    exact,
)
from robot_retarget.graph.placed_scene import pelvis_path
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import CAUSAL_DIFFERENCE, SECOND_DIFFERENCE, STEP, THIRD_DIFFERENCE, limit
from robot_retarget.graph.weights import REFERENCE_FPS
from robot_retarget.robot.coupling import Coupling as Constraints
from robot_retarget.robot.dynamics import root_dofs, root_travel
from robot_retarget.robot.kinematics import carrying, tangent_names

# Joint range and joint speed: bounds on the hinges.


class RangeKind(Kind):
    """Angle of every hinge [rad], within the robot's range."""

    name = "range"
    role = Role.BOUND
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track | None:
        """[lower, upper] of the robot."""
        robot, frames = context.robot, len(context.human)
        lower, upper = robot.ranges(np.arange(frames) / context.human.fps)
        kind = LedRangeKind() if robot.led else self
        return limit(kind, [(j, "zero") for j in robot.joint_names], lower, upper, frames)


class LedRangeKind(RangeKind):
    """The same of a robot some of whose hinges follow a trajectory, from the first frame of a stream on."""

    follows_human = True

    def step(self, context: StreamFrame, memory: dict[str, Any]) -> FrameTargets:
        """[lower, upper] at the time of the frame."""
        memory["time"] = memory["time"] + context.seconds if memory else 0.0
        lower, upper = context.robot.ranges(np.array([memory["time"]]))
        return lower[0], upper[0], np.inf


class SpeedKind(Kind):
    """Speed of every hinge from frame to frame [rad/s], within the robot's."""

    name = "speed"
    role = Role.BOUND
    stencil = STEP
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track | None:
        """[−v, v] of the robot."""
        robot = context.robot
        most = np.asarray(robot.max_speed)
        return limit(self, [(j, f"{j} a frame before") for j in robot.joint_names], -most, most, len(context.human))


# Rest: a weak pull of every joint to the standing pose, so that joints without other targets stay there.


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

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the stand's angles outside the human's motion."""
        inside = frames.share >= 1
        lower, upper = (np.where(inside, bound, measured[self.name]) for bound in (track.lower, track.upper))
        return replace(track, lower=lower, upper=upper, priority=track.priority + (1 - frames.share) * frames.standing)

    def stood(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the priority of a stand."""
        return replace(track, priority=np.full((1, len(track)), frames.standing))

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


# Coupling: geared joints and closed chains, the equality constraints of the model.


@dataclass(frozen=True)
class CouplingKind(Kind):
    """Violation of every constraint [m or rad], 0; closed by Newton steps at the end of a descent."""

    name: str = "coupling"
    form = Form.NUMERIC
    follows_human = False
    priority: float = 30.0
    """π over the squared leg: descents bend chains a little, and close them at the end [-]. Half and double change the
    cost of a walk of ToddlerBot by less than 0.1 %."""

    def targets(self, context: RetargetContext) -> Track | None:
        """Return 0; no edges for a robot without constraints."""
        constraints = Constraints(context.robot)
        if not constraints.present:
            return None
        count = len(constraints(context.robot.neutral())[0])
        ends = [(f"constraint {k}", "closed") for k in range(count)]
        return exact(self, ends, np.zeros((len(context.human), count)), self.priority, context.leg)

    def rows(self, track: Track, state: RowState) -> MeasureRows:
        """Return all constraints, by MuJoCo."""
        values, slope = _constraints(state)(state.qpos)
        return MeasureRows(values, slope, np.arange(len(values)))

    def projected(self, track: Track, state: RowState) -> Floats:
        """Return the nearby configuration (nq,) that closes the chains."""
        return _constraints(state).close_chains(state.qpos)


def _constraints(state: RowState) -> Constraints:
    if "constraints" not in state.memory:
        state.memory["constraints"] = Constraints(state.robot)
    return state.memory["constraints"]


# Smoothness of clips and inertia of streams: costs on the change of the configuration from frame to frame.

BOUNCE = 0.05
"""Standard deviation of the Gaussian over the human's height, whose acceleration the root has [s]: captures are noisy.
Half and double change the cost of a dance on the G1 by less than 0.1 % and its jerk by 1 %."""
UP = "root 2"
"""The height of a free root among tangent directions."""


class SmoothnessKind(Kind):
    """Second difference q_{t−1} − 2 q_t + q_{t+1} of every tangent direction [rad or m].

    The target is 0, and for the height of the root that of the human's path: a body in flight falls, and gait bounces.
    """

    name = "smoothness"
    stencil = SECOND_DIFFERENCE
    form = Form.JOINT

    def targets(self, context: RetargetContext) -> Track:
        """π at the frame rate: a difference of order n scales with the time between frames to the power n."""
        human, names, order = context.human, tangent_names(context.robot), len(self.stencil) - 1
        weight, scales = self._weights(context)
        target = np.zeros((len(human), len(names)))
        if context.robot.floating:
            flies = np.zeros(len(human), bool) if human.falls is None else human.falls[:, 1] > 0
            height = pelvis_path(human, context.match)[:, 2]
            target[1 : 1 - order, names.index(UP)] = _bounce(height, human.fps, flies, order)
        ends = [(name, f"{('second', 'third')[order - 2]} difference") for name in names]
        return exact(self, ends, target, weight * (human.fps / REFERENCE_FPS) ** (2 * order), scales)

    def _weights(self, context: RetargetContext) -> tuple[float, Floats]:
        """Return π at `REFERENCE_FPS`, and the scales (nv,)."""
        weights = context.weights
        return weights.smooth, _scales(context, weights.smooth_root, weights.smooth_turn)

    def grounded(self, track: Track, grounding: Grounding) -> Track:
        """Return the root's target without free fall."""
        names, order = [name for name, _ in track.ends], len(self.stencil) - 1
        if UP not in names:
            return track
        target, flies = track.lower.copy(), np.zeros(len(track.lower), bool)
        target[1 : 1 - order, names.index(UP)] = _bounce(grounding.height, grounding.fps, flies, order)
        return replace(track, lower=target, upper=target)

    def played(self, track: Track, measured: Measures, frames: PlaybackFrames) -> Track:
        """Return the target 0: the pace differs from the human's."""
        return replace(track, lower=np.zeros_like(track.lower), upper=np.zeros_like(track.upper))


def _bounce(height: Floats, fps: float, flies: Bools, order: int) -> Floats:
    """Return the differences (T − order,) of heights (T,) [m], whose second differences are smoothed in and between flights.

    The smoothing keeps the sum of each part, which is its change of speed. A flight stays a free fall, and a stance regains the speed
    that the flight lost.
    """
    bend, flies = np.diff(height, 2), flies[1:-1]
    for start, stop in (*intervals(flies), *intervals(~flies)):
        bend[start:stop] = gaussian_filter1d(bend[start:stop], BOUNCE * fps, mode="reflect")
    return np.diff(bend, order - 2)


class JerkKind(SmoothnessKind):
    """Third difference q_{t+2} − 3 q_{t+1} + 3 q_t − q_{t−1} of every tangent direction [rad or m].

    It keeps the accelerations of a fast limb and of a bounce, and stops what alternates from frame to frame.
    """

    name = "jerk"
    stencil = THIRD_DIFFERENCE

    def _weights(self, context: RetargetContext) -> tuple[float, Floats]:
        return context.weights.jerk, _scales(context, context.weights.smooth_root, 1.0)


class InertiaKind(Kind):
    """Deviation of every tangent direction [rad or m] from the motion of a damped spring, 0; for streams."""

    name = "inertia"
    stencil = CAUSAL_DIFFERENCE
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track:
        """The weights of legs, of other hinges and of the root."""
        ends, weights = [(name, "two frames before") for name in tangent_names(context.robot)], context.weights
        scales = _scales(context, weights.inertia_root, weights.inertia_root)
        priority = np.where(_of_legs(context), weights.inertia_leg, weights.inertia)
        priority[root_dofs(context.robot)] = 1.0
        return exact(self, ends, np.zeros((len(context.human), len(ends))), priority, scales)


def _of_legs(context: RetargetContext) -> Bools:
    """Return (nv,) whether a tangent direction moves an ankle relative to the pelvis."""
    moves, sites = carrying(context.robot.model), context.match.anatomy.sites
    still = moves[sites["pelvis"].body if "pelvis" in sites else context.robot.root_body]
    ankles = [moves[sites[part].body] for part in ("l_ankle", "r_ankle") if part in sites]
    return np.logical_or.reduce([still != ankle for ankle in (still, *ankles)])


def _scales(context: RetargetContext, travel: float, turn: float) -> Floats:
    """(nv,) 1 for hinges; smaller for the root, whose squares count `travel` times in metres and `turn` times in radians."""
    robot = context.robot
    factors = np.ones(robot.model.nv)
    factors[root_dofs(robot)], factors[root_travel(robot)] = turn, travel
    return 1 / np.sqrt(np.maximum(factors, 1e-9))
