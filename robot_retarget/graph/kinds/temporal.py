"""Smoothness of clips and inertia of streams: costs on the change of the configuration from frame to frame."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from robot_retarget.base.arrays import Bools, Floats
from robot_retarget.graph.kind import Form, Kind, Phase, RetargetContext, Track, exact
from robot_retarget.graph.path import pelvis_path
from robot_retarget.graph.phase import PlaybackPhase
from robot_retarget.graph.role import CAUSAL_DIFFERENCE, SECOND_DIFFERENCE
from robot_retarget.graph.weights import REFERENCE_FPS
from robot_retarget.robot.dynamics import root_dofs, root_travel
from robot_retarget.robot.kinematics import carrying, tangent_names

BOUNCE = 0.05
"""Standard deviation of the Gaussian over the human's height, whose acceleration the root has [s]: captures are noisy."""
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
        """κ at the frame rate: a second difference scales with the squared time between frames."""
        human, weights, names = context.human, context.weights, tangent_names(context.robot)
        kappa = weights.smooth * (human.fps / REFERENCE_FPS) ** 4
        bend = np.zeros((len(human), len(names)))
        if context.robot.floating:
            height = gaussian_filter1d(pelvis_path(human, context.match)[:, 2], BOUNCE * human.fps, mode="nearest")
            bend[1:-1, names.index(UP)] = np.diff(height, 2)
        ends = [(name, "second difference") for name in names]
        return exact(self, ends, bend, kappa, _scales(context, weights.smooth_root, weights.smooth_turn))

    def renewed(self, track: Track, measured: Floats | None, phase: Phase) -> Track:
        """Return the target 0 in a balanced playback, whose pace differs from the human's."""
        if not isinstance(phase, PlaybackPhase):
            return track
        return replace(track, lower=np.zeros_like(track.lower), upper=np.zeros_like(track.upper))


class InertiaKind(Kind):
    """Deviation of every tangent direction [rad or m] from the motion of a damped spring, 0; for streams."""

    name = "inertia"
    stencil = CAUSAL_DIFFERENCE
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track:
        """The weights of legs, of other hinges and of the root, times that of the time since the frame before (`realtime.follower`)."""
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
