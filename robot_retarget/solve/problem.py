"""One frame's problem as CasADi functions: edges through forward kinematics to a quadratic model in the tangent v.

    minimise  Σ π ϱ(e_ij)  +  Σ ϖ e_ij²  +  Σ w ‖(x_a − x_b)/d_ab − u‖²  +  Σ w ‖R e − r‖²  +  w ‖x_pelvis − y‖²/ℓ²
                 + Σ h ‖c(q ⊕ v) − p‖²/ℓ²  +  w ‖q_joint − rest‖²
    subject to  lower ≤ q_joint ⊕ v ≤ upper,   z_sole(q ⊕ v) ≥ 0
    with  e_ij = (d_ij(q ⊕ v) − δ_ij)/τ_ij,   ϱ(e) = 2 s² (√(1 + (e/s)²) − 1)

ϱ is e² for small errors and 2 s |e| for large ones: two builds differ in a few distances (shoulder to shoulder, head to
shoulder) that no posture can mend, and squares would bend the rest of the body towards them. Its quadratic model is
that of iteratively reweighted least squares, which lies above it everywhere. Touching pairs ϖ count by their squares.
The sum with h holds the corners c of a standing sole at their places p; its weight is so high that they stay within a
tenth of a millimetre where the leg has six hinges to reach them, and never makes the rest infeasible.

What edges measure and its Jacobian F are scalar instructions (`measures.py`); with weights W, wishes and residuals r the
quadratic model is Fᵀ W r and Fᵀ W F, two sparse products; machine code has them as scalar instructions too, of what is
not zero, and of Fᵀ W F one half.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges, Weights
from robot_retarget.describe.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import carrying
from robot_retarget.solve.compiled import Compiled, dense_function
from robot_retarget.solve.footing import CORNERS
from robot_retarget.solve.measures import Measures, build_measures
from robot_retarget.solve.native import machine_code


@dataclass(frozen=True)
class Problem:
    """The compiled problem of one robot and one match; it holds no frame and no state."""

    robot: Robot
    match: Match
    model: Compiled
    """(q, δ, π, ϖ, u, r, y, h, p) ↦ cost, gradient (nv), normal matrix (nv, nv), floor heights (F), their slopes (F, nv)."""
    cost: Compiled
    """The first of these alone."""
    stress: Compiled
    """(q, δ) ↦ (d − δ)/τ of every posture edge (E)."""
    heights: Compiled
    """q ↦ the sole points' heights over the floor (F) [m]."""
    corners: Compiled
    """q ↦ the corners of the soles, stacked (3 · 4 · feet) [m]."""
    feet: tuple[str, ...]
    soles: int
    """F, how many sole points stay above the floor."""
    native: bool = False
    """Whether `model` and `cost` are machine code."""


def build_problem(
    robot: Robot, match: Match, edges: Edges, weights: Weights | None = None, native: bool = False
) -> Problem:
    """Assemble the functions for a robot; the wished values stay parameters.

    Args:
        native: take machine code where it can be had (`native.py`): seconds once, kept for later.
    """
    measures = build_measures(robot, match, edges)
    terms = _Terms(robot, match, edges, weights or Weights(), _Wished(edges, CORNERS * len(measures.feet)))
    q, wished = ca.MX.sym("q", robot.model.nq), terms.wished
    model, alone = _model(measures, terms, q), measures.values(q)
    cost = ca.Function("cost", [q, *wished.all], [ca.densify(terms.around(alone)[0])])
    compiled = [machine_code(function.expand()) if native else None for function in (model, cost)]
    return Problem(
        robot,
        match,
        Compiled(compiled[0] or model),
        Compiled(compiled[1] or cost),
        dense_function("stress", [q, wished.delta], [terms.stretch(alone)]),
        Compiled(measures.heights),
        Compiled(measures.corners),
        measures.feet,
        measures.heights.numel_out(0),
        None not in compiled,
    )


def _model(measures: Measures, terms: "_Terms", q: ca.MX) -> ca.Function:
    """q and all that is wished ↦ `Problem.model`."""
    values, slopes, heights, height_slopes = measures.slopes(q)
    cost, residual, weight = terms.around(values)
    weighted = ca.diag(weight) @ slopes
    normal = ca.triu2symm(ca.triu(weighted.T @ slopes))
    found = [cost, weighted.T @ residual, normal, heights, height_slopes]
    return ca.Function("model", [q, *terms.wished.all], [ca.densify(each) for each in found])


@dataclass(frozen=True)
class _Terms:
    """Everything that is summed, as expressions of what is measured."""

    robot: Robot
    match: Match
    edges: Edges
    weights: Weights
    wished: "_Wished"

    def around(self, values: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """The cost, and the residuals and weights whose weighted squares are its quadratic model."""
        give, pi, squared = self.weights.give, self.wished.pi, self._squared()
        residual, stretch = values - self._wish(), self.stretch(values)
        pairs, root = stretch.numel(), ca.sqrt(1 + (stretch / give) ** 2)
        cost = 2 * give**2 * ca.dot(pi, root - 1) + ca.dot(squared, residual**2)
        giving = pi / root / self.edges.path_length**2
        return cost, residual, ca.vertcat(giving + squared[:pairs], squared[pairs:])

    def stretch(self, values: ca.MX) -> ca.MX:
        """(d − δ)/τ of the posture edges."""
        return (values[: len(self.edges.pairs)] - self.wished.delta) / self.edges.path_length

    def _wish(self) -> ca.MX:
        """What all that is measured should be."""
        wished, standing = self.wished, self.robot.standing()[self.robot.qpos_index]
        return ca.vertcat(wished.delta, wished.u, wished.r, wished.y, standing, wished.p)

    def _squared(self) -> ca.MX:
        """Weights of what counts by its square: of pairs, the touches."""
        w, edges, leg = self.weights, self.edges, self.match.robot_leg
        touching = np.eye(len(edges.pairs))[:, edges.touching] / edges.path_length[:, None] ** 2
        foot = np.array([segment.endswith("foot") for segment in edges.segments])
        return ca.vertcat(
            ca.sparsify(ca.DM(touching)) @ self.wished.touch,
            np.repeat(edges.line_weight, 3),
            np.repeat(np.where(foot, w.marker / 3, w.marker), 6),
            np.full(3, w.path / leg**2),
            np.where(_unled(self.robot, self.match, edges), w.wrist, w.rest),
            self.wished.h / leg**2,
        )


class _Wished:
    """The parameters of a frame as symbols."""

    def __init__(self, edges: Edges, corners: int):
        self.delta, self.pi = ca.MX.sym("delta", len(edges.pairs)), ca.MX.sym("pi", len(edges.pairs))
        self.u, self.r = ca.MX.sym("u", edges.direction[0].size), ca.MX.sym("r", 3 * 2 * len(edges.segments))
        self.touch = ca.MX.sym("touch", len(edges.touching))
        self.y, self.h, self.p = ca.MX.sym("y", 3), ca.MX.sym("h", 3 * corners), ca.MX.sym("p", 3 * corners)
        self.all = [self.delta, self.pi, self.touch, self.u, self.r, self.y, self.h, self.p]


def frame_parameters(edges: Edges, frame: int) -> tuple[Floats, ...]:
    """δ, π, ϖ, u, r, y of one frame, as `Problem.model` takes them before the footholds h and p."""
    return (
        edges.distance[frame],
        edges.priority[frame],
        edges.touch[frame],
        edges.direction[frame].ravel(),
        edges.frames[frame][:, :, [0, 2]].transpose(0, 2, 1).ravel(),
        edges.root[frame],
    )


def _unled(robot: Robot, match: Match, edges: Edges) -> np.ndarray:
    """(n,) the wrists without markers: the hinges that move a hand and no other keypoint."""
    moves, bodies = carrying(robot.model)[match.points.bodies][:, robot.dof_index], match.points.bodies
    marked = [match.anatomy.frames[segment][0] for segment in edges.segments]
    hands = [k for k, keypoint in enumerate(match.keypoints) if keypoint[2:] == "hand" and bodies[k] not in marked]
    return (moves.sum(axis=0) == 1) & moves[hands].any(axis=0)
