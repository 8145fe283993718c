"""Smoothness of clips and inertia of streams: costs on the change of the configuration from frame to frame."""

import numpy as np

from robot_retarget.graph.kind import Form, Kind, RetargetContext, Track, exact
from robot_retarget.graph.role import CAUSAL_DIFFERENCE, SECOND_DIFFERENCE
from robot_retarget.graph.weights import REFERENCE_FPS
from robot_retarget.robot.kinematics import tangent_names


class SmoothnessKind(Kind):
    """Second difference q_{t−1} − 2 q_t + q_{t+1} of every tangent direction [rad or m], 0."""

    name = "smoothness"
    stencil = SECOND_DIFFERENCE
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track:
        """κ at the frame rate: a second difference scales with the squared time between frames."""
        kappa = context.weights.smooth * (context.human.fps / REFERENCE_FPS) ** 4
        ends = [(name, "second difference") for name in tangent_names(context.robot)]
        return exact(self, ends, np.zeros((len(context.human), len(ends))), kappa, _scales(context))


class InertiaKind(Kind):
    """Deviation of every tangent direction [rad or m] from the motion of a damped spring, 0; for streams."""

    name = "inertia"
    stencil = CAUSAL_DIFFERENCE
    form = Form.JOINT
    follows_human = False

    def targets(self, context: RetargetContext) -> Track:
        """1 for hinges, times the weight of the time since the frame before (`realtime.follower`)."""
        ends = [(name, "two frames before") for name in tangent_names(context.robot)]
        return exact(self, ends, np.zeros((len(context.human), len(ends))), 1.0, _scales(context))


def _scales(context: RetargetContext) -> np.ndarray:
    """(nv,) 1 for hinges; smaller for the root, which weighs more."""
    scales = np.full(context.robot.model.nv, 1 / np.sqrt(max(context.weights.smooth_root, 1e-9)))
    scales[context.robot.dof_index] = 1.0
    return scales
