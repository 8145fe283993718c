"""One frame's problem as CasADi functions: edges through forward kinematics to a quadratic model in the tangent v.

    minimise  Σ π (d_ij(q ⊕ v) − δ_ij)²/τ_ij²  +  Σ w ‖(x_a − x_b)/ℓ − u‖²  +  Σ w ‖R e − r‖²  +  w ‖x_pelvis − y‖²/ℓ²
    subject to  lower ≤ q_joint ⊕ v ≤ upper,   z_sole(q ⊕ v) ≥ 0

The structure points → distances → normal matrix is kept (nothing is expanded to scalars beyond the kinematics), so one
evaluation is a handful of dense products.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.retarget.edges import Edges, Weights
from robot_retarget.retarget.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import point_function

MARKER_ARM = 0.1
"""Markers stand this far from their segment's origin [m]; the cost does not depend on it."""


@dataclass(frozen=True)
class Problem:
    """The compiled problem of one robot and one match; it holds no frame and no state."""

    robot: Robot
    match: Match
    model: ca.Function
    """(q, δ, π, u, r, y) ↦ cost, gradient (nv), normal matrix (nv, nv), floor heights (F), their Jacobian (F, nv)."""
    stress: ca.Function
    """(q, δ) ↦ (d − δ)/τ of every posture edge (E)."""
    heights: ca.Function
    """q ↦ the sole points' heights over the floor (F) [m]."""
    soles: int
    """F, how many sole points stay above the floor."""


def build_problem(robot: Robot, match: Match, edges: Edges, weights: Weights | None = None) -> Problem:
    """Assemble the functions for a robot; the wished values stay parameters."""
    w = weights or Weights()
    points, sole_rows = _all_points(robot, match, edges)
    kinematics = point_function(robot, points)
    q = ca.MX.sym("q", robot.model.nq)
    x, jacobian = kinematics(q)
    delta, pi = ca.MX.sym("delta", len(edges.pairs)), ca.MX.sym("pi", len(edges.pairs))
    u, r = ca.MX.sym("u", edges.direction[0].size), ca.MX.sym("r", 3 * 2 * len(edges.segments))
    y = ca.MX.sym("y", 3)
    stretch, rows = _posture(x, jacobian, edges, delta)
    blocks = [(ca.sqrt(pi) * stretch, ca.diag(ca.sqrt(pi)) @ rows)]
    blocks += [_compass(x, jacobian, edges, u), _markers(x, jacobian, edges, r, w), _path(x, jacobian, match, y, w)]
    residual = ca.vertcat(*[b[0] for b in blocks])
    rows = ca.vertcat(*[b[1] for b in blocks])
    floor = x[sole_rows], jacobian[sole_rows, :]
    outputs = [ca.sumsqr(residual), rows.T @ residual, rows.T @ rows, *floor]
    model = ca.Function("model", [q, delta, pi, u, r, y], outputs)
    stress = ca.Function("stress", [q, delta], [stretch])
    heights = ca.Function("heights", [q], [x[sole_rows]])
    return Problem(robot, match, model, stress, heights, len(sole_rows))


def frame_parameters(edges: Edges, frame: int) -> tuple[Floats, ...]:
    """δ, π, u, r, y of one frame, as `Problem.model` takes them."""
    return (
        edges.distance[frame],
        edges.priority[frame],
        edges.direction[frame].ravel(),
        edges.frames[frame][:, :, [0, 2]].transpose(0, 2, 1).ravel(),
        edges.root[frame],
    )


def _all_points(robot: Robot, match: Match, edges: Edges) -> tuple[Points, list[int]]:
    """Keypoints, then per segment its origin and two markers, then the soles; and the rows of the soles' heights."""
    bodies, offsets = [*match.points.bodies], [*match.points.offsets]
    for segment in edges.segments:
        body, axes = match.anatomy.frames[segment]
        bodies += [body] * 3
        offsets += [np.zeros(3), MARKER_ARM * axes[:, 0], MARKER_ARM * axes[:, 2]]
    first = len(bodies)
    if robot.root_joints.size:
        for sole in match.anatomy.soles.values():
            bodies += [*sole.bodies]
            offsets += [*sole.offsets]
    return Points(np.array(bodies), np.array(offsets)), [3 * p + 2 for p in range(first, len(bodies))]


def _difference(count: int, plus: Ints, minus: Ints) -> ca.DM:
    """(E, P) with +1 at `plus` and −1 at `minus`: takes stacked points to their differences."""
    matrix = np.zeros((len(plus), count))
    matrix[np.arange(len(plus)), plus] = 1
    matrix[np.arange(len(minus)), minus] = -1
    return ca.sparsify(ca.DM(matrix))


def _posture(x: ca.MX, jacobian: ca.MX, edges: Edges, delta: ca.MX) -> tuple[ca.MX, ca.MX]:
    """(d − δ)/τ and its Jacobian, one row an edge."""
    take = _difference(x.numel() // 3, edges.pairs[:, 0], edges.pairs[:, 1])
    apart = take @ ca.reshape(x, 3, -1).T
    d = ca.sqrt(ca.sum2(apart**2) + 1e-12)
    unit = apart / ca.repmat(d, 1, 3)
    axis_rows = [take @ jacobian[axis::3, :] for axis in range(3)]
    slope = sum(ca.repmat(unit[:, a], 1, jacobian.shape[1]) * axis_rows[a] for a in range(3))
    scale = ca.DM(1 / edges.path_length)
    return (d - delta) * scale, ca.diag(scale) @ slope


def _compass(x: ca.MX, jacobian: ca.MX, edges: Edges, u: ca.MX) -> tuple[ca.MX, ca.MX]:
    """√w ((x_a − x_b)/ℓ − u), three rows a line."""
    take = ca.kron(_difference(x.numel() // 3, edges.lines[:, 0], edges.lines[:, 1]), ca.DM.eye(3))
    root = ca.DM(np.repeat(np.sqrt(edges.line_weight), 3))
    scaled = ca.diag(root * ca.DM(np.repeat(1 / edges.line_length, 3))) @ take
    return scaled @ x - root * u, scaled @ jacobian


def _markers(x: ca.MX, jacobian: ca.MX, edges: Edges, r: ca.MX, w: Weights) -> tuple[ca.MX, ca.MX]:
    """√w (R e − r) for the forward and up of every segment."""
    first = len(edges.keypoints)
    origin = np.repeat(first + 3 * np.arange(len(edges.segments)), 2)
    marker = (first + 3 * np.arange(len(edges.segments))[:, None] + [1, 2]).ravel()
    take = ca.kron(_difference(x.numel() // 3, marker, origin), ca.DM.eye(3))
    scaled = take * (np.sqrt(w.marker) / MARKER_ARM)
    return scaled @ x - np.sqrt(w.marker) * r, scaled @ jacobian


def _path(x: ca.MX, jacobian: ca.MX, match: Match, y: ca.MX, w: Weights) -> tuple[ca.MX, ca.MX]:
    """√w (x_pelvis − y)/ℓ with ℓ the length of a leg, or of all bones where there are none."""
    legs = [match.index(k) for k in ("l_knee", "l_ankle") if k in match.keypoints]
    length = match.robot_bones[legs].sum() if legs else match.robot_bones.sum()
    k = match.index("pelvis") if "pelvis" in match.keypoints else 0
    scale = np.sqrt(w.path) / float(length)
    return (x[3 * k : 3 * k + 3] - y) * scale, jacobian[3 * k : 3 * k + 3, :] * scale
