"""A clip as one problem: the targets of its frames with the differences between them, and its linear model at a path."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.track import SECOND_DIFFERENCE, THIRD_DIFFERENCE
from robot_retarget.solver.banded import DifferenceCosts
from robot_retarget.solver.clip_step import StepRows
from robot_retarget.solver.limits import JointBounds, Targets, within_speeds
from robot_retarget.solver.options import Smoothing
from robot_retarget.solver.quadratic import Quadratic
from robot_retarget.solver.sqp import FrameSolver

LEAST = 1e-6
"""Least damping [1/rad²], and the least curvature of a frame over the cost of the clip: both prevent a division by 0."""


@dataclass(frozen=True, eq=False)
class ClipProblem:
    """The targets of consecutive frames of a graph; the first `fixed` of them are known."""

    solver: FrameSolver
    all_targets: Targets
    smoothing: Smoothing
    differences: tuple[DifferenceCosts, ...]
    bounds: JointBounds
    """(T, n) of the hinges."""
    reach: Floats
    """(T, n) how far the hinges turn from the frame before [rad]."""
    fps: float
    fixed: int = 0

    def __len__(self) -> int:
        return len(self.all_targets)

    def limited(self, qpos: Floats) -> Floats:
        """Return configurations (T, nq) with their hinges within ranges and joint speeds; fixed frames stay."""
        found, hinges = qpos.copy(), self.solver.robot.qpos_index
        angles = found[:, hinges].clip(self.bounds.lower, self.bounds.upper)
        angles[: self.fixed] = found[: self.fixed, hinges]
        found[:, hinges] = within_speeds(angles, self.reach[1:], self.fixed)
        return found


def clip_of(solver: FrameSolver, targets: Targets, smoothing: Smoothing, fps: float, fixed: int = 0) -> ClipProblem:
    """Assemble a clip from the targets of its frames.

    Args:
        solver: measures single frames.
        targets: of T frames, those of temporal costs included.
        smoothing: options of the steps.
        fps: frames per second [1/s].
        fixed: number of first frames that are known.
    """
    limits, orders = solver.problem.limits, {2: SECOND_DIFFERENCE, 3: THIRD_DIFFERENCE}
    differences = tuple(
        DifferenceCosts.of(k, limits.differences(targets, stencil), len(targets)) for k, stencil in orders.items()
    )
    bounds = limits.bounds(targets)
    return ClipProblem(solver, targets, smoothing, differences, bounds, bounds.speed / fps, fps, fixed)


@dataclass(frozen=True, eq=False)
class ClipModel:
    """The clip linearised at a path."""

    cost: Floats
    """(M,) of the moving frames: their own, the differences about them, and penalties."""
    own: Floats
    """(M,) those of the frames without differences and joint speeds."""
    gradient: Floats
    """Half of that of the costs without penalties (M, nv)."""
    frames: Quadratic
    """The models of single frames."""
    rows: StepRows
    changes: Floats
    """(M, n) of the hinges from the frame before [rad]."""

    def surprise(self, step: Floats, own: Floats) -> Floats:
        """Return (M,) by how much the costs of frames after a step (M, nv) exceed those of the model, over the model's curvature."""
        frames, rows = self.frames, self.rows
        bent = ((frames.normal @ step[..., None])[..., 0] * step).sum(axis=1)
        pressed = rows.penalties(step) - rows.penalties()
        model = self.own + 2 * (frames.gradient * step).sum(axis=1) + bent + pressed
        return (own - model) / np.maximum(bent + np.abs(pressed), LEAST * self.typical)

    @property
    def total(self) -> float:
        """The cost of the clip."""
        return float(self.cost.sum())

    @property
    def typical(self) -> float:
        """The cost of a clip of median frames: frames with hard edges out of reach do not count for more."""
        return float(np.median(self.cost)) * len(self.cost)
