"""Smoothness of clips and inertia of streams: costs on the change of the configuration from frame to frame."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.graph.kinds.kind import RetargetContext, Role
from robot_retarget.graph.role import CAUSAL_DIFFERENCE, SECOND_DIFFERENCE
from robot_retarget.graph.track import Track, exact
from robot_retarget.graph.weights import REFERENCE_FPS
from robot_retarget.robot import Robot


@dataclass(frozen=True)
class SmoothnessKind:
    """Second difference q_{t−1} − 2 q_t + q_{t+1} of every tangent direction [rad or m], 0."""

    name: str = "smoothness"
    role: Role = Role.COST
    stencil: tuple[int, ...] = SECOND_DIFFERENCE

    def targets(self, context: RetargetContext) -> Track:
        """κ at the frame rate: a second difference scales with the squared time between frames."""
        kappa = context.weights.smooth * (context.human.fps / REFERENCE_FPS) ** 4
        ends = [(name, "second difference") for name in tangent_names(context.robot)]
        return exact(self, ends, np.zeros((len(context.human), len(ends))), kappa, _scales(context))


@dataclass(frozen=True)
class InertiaKind:
    """Deviation of every tangent direction [rad or m] from the motion of a damped spring, 0; for streams."""

    name: str = "inertia"
    role: Role = Role.COST
    stencil: tuple[int, ...] = CAUSAL_DIFFERENCE

    def targets(self, context: RetargetContext) -> Track:
        """1 for hinges, times the weight of the time since the frame before (`realtime.follower`)."""
        ends = [(name, "two frames before") for name in tangent_names(context.robot)]
        return exact(self, ends, np.zeros((len(context.human), len(ends))), 1.0, _scales(context))


def tangent_names(robot: Robot) -> list[str]:
    """(nv,) a hinge's name, or `root 0`, `root 1` …"""
    names = [f"root {k}" for k in range(robot.model.nv)]
    for dof, joint in zip(robot.dof_index, robot.joint_names, strict=True):
        names[dof] = joint
    return names


def _scales(context: RetargetContext) -> np.ndarray:
    """(nv,) 1 for hinges; smaller for the root, which weighs more."""
    scales = np.full(context.robot.model.nv, 1 / np.sqrt(max(context.weights.smooth_root, 1e-9)))
    scales[context.robot.dof_index] = 1.0
    return scales
