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

The structure points → distances → normal matrix is kept (nothing is expanded to scalars beyond the kinematics), so one
evaluation is a handful of dense products.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.retarget.compiled import Compiled, dense_function
from robot_retarget.retarget.edges import Edges, Weights
from robot_retarget.retarget.footing import sole_corners
from robot_retarget.retarget.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import place_function, point_function
from robot_retarget.robot.separation import carrying

MARKER_ARM = 0.1
"""Markers stand this far from their segment's origin [m]; the cost does not depend on it."""


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


def build_problem(robot: Robot, match: Match, edges: Edges, weights: Weights | None = None) -> Problem:
    """Assemble the functions for a robot; the wished values stay parameters."""
    points, sole_rows, corner_rows, feet = _all_points(robot, match, edges)
    q, wished = ca.MX.sym("q", robot.model.nq), _Wished(edges, len(corner_rows) // 3)
    terms = _Terms(robot, match, edges, weights or Weights(), wished, corner_rows)
    merge = _pelvis_between_hips(match, len(points))
    x, jacobian = (merge @ value for value in point_function(robot, points)(q))
    cost, residual, rows = terms.around(q, x, jacobian)
    places = merge @ place_function(robot, points)(q)
    nowhere = ca.MX(places.numel(), robot.model.nv)
    return Problem(
        robot,
        match,
        dense_function(
            "model",
            [q, *wished.all],
            [cost, rows.T @ residual, rows.T @ rows, x[sole_rows], jacobian[sole_rows, :]],
        ),
        dense_function("cost", [q, *wished.all], [terms.around(q, places, nowhere)[0]]),
        dense_function("stress", [q, wished.delta], [_posture(places, nowhere, edges, wished.delta)[0]]),
        dense_function("heights", [q], [place_function(robot, _some(points, sole_rows))(q)[2::3]]),
        dense_function("corners", [q], [place_function(robot, _some(points, corner_rows))(q)]),
        feet,
        len(sole_rows),
    )


@dataclass(frozen=True)
class _Terms:
    """Everything that is summed, as expressions of the points x and their Jacobian."""

    robot: Robot
    match: Match
    edges: Edges
    weights: Weights
    wished: "_Wished"
    corners: list[int]

    def around(self, q: ca.MX, x: ca.MX, jacobian: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """The cost, and residuals and rows whose squares are its quadratic model."""
        w, wished, edges = self.weights, self.wished, self.edges
        stretch, slope = _posture(x, jacobian, edges, wished.delta)
        give = ca.sqrt(1 + (stretch / w.give) ** 2)
        root = ca.sqrt(wished.pi / give)
        squared = [
            _touch(stretch, slope, edges, wished.touch),
            _compass(x, jacobian, edges, wished.u),
            _markers(x, jacobian, edges, wished.r, w),
            _path(x, jacobian, self.match, wished.y, w),
            _rest(self.robot, self.match, edges, q, w),
            _holds(x[self.corners], jacobian[self.corners, :], wished, self.match.robot_leg),
        ]
        blocks = [(root * stretch, ca.diag(root) @ slope), *squared]
        residual, rows = (ca.vertcat(*[block[k] for block in blocks]) for k in (0, 1))
        cost = 2 * w.give**2 * ca.dot(wished.pi, give - 1) + sum(ca.sumsqr(block[0]) for block in squared)
        return cost, residual, rows


def _some(points: Points, rows: list[int]) -> Points:
    """The points that stacked coordinates belong to."""
    chosen = np.unique(np.array(rows, dtype=np.int64) // 3)
    return Points(points.bodies[chosen], points.offsets[chosen])


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


def _all_points(robot: Robot, match: Match, edges: Edges) -> tuple[Points, list[int], list[int], tuple[str, ...]]:
    """Keypoints, per segment its origin and two markers, soles, sole corners; rows of sole heights and of corners."""
    bodies, offsets = [*match.points.bodies], [*match.points.offsets]
    for segment in edges.segments:
        body, axes = match.anatomy.frames[segment]
        bodies += [body] * 3
        offsets += [np.zeros(3), MARKER_ARM * axes[:, 0], MARKER_ARM * axes[:, 2]]
    feet = tuple(match.anatomy.soles) if robot.root_joints.size else ()
    first = len(bodies)
    for points in [match.anatomy.soles[foot] for foot in feet]:
        bodies, offsets = [*bodies, *points.bodies], [*offsets, *points.offsets]
    second = len(bodies)
    for points in [sole_corners(match.anatomy, foot) for foot in feet]:
        bodies, offsets = [*bodies, *points.bodies], [*offsets, *points.offsets]
    heights = [3 * p + 2 for p in range(first, second)]
    return Points(np.array(bodies), np.array(offsets)), heights, [*range(3 * second, 3 * len(bodies))], feet


def _pelvis_between_hips(match: Match, count: int) -> ca.DM:
    """(3P, 3P) that leaves stacked points as they are, but for the pelvis: the middle of the hips, as of the human."""
    mean = np.eye(count)
    if {"pelvis", "l_hip", "r_hip"} <= set(match.keypoints):
        mean[match.index("pelvis")] = np.eye(count)[[match.index("l_hip"), match.index("r_hip")]].mean(axis=0)
    return ca.sparsify(ca.kron(ca.DM(mean), ca.DM.eye(3)))


def _difference(count: int, plus: Ints, minus: Ints) -> ca.DM:
    """(E, P) with +1 at `plus` and −1 at `minus`: takes stacked points to their differences."""
    matrix = np.zeros((len(plus), count))
    matrix[np.arange(len(plus)), plus] = 1
    matrix[np.arange(len(minus)), minus] = -1
    return ca.sparsify(ca.DM(matrix))


def _posture(x: ca.MX, jacobian: ca.MX, edges: Edges, delta: ca.MX) -> tuple[ca.MX, ca.MX]:
    """(d − δ)/τ and its Jacobian, one row an edge."""
    d, slope, *_ = _apart(x, jacobian, edges.pairs)
    scale = ca.DM(1 / edges.path_length)
    return (d - delta) * scale, ca.diag(scale) @ slope


def _apart(x: ca.MX, jacobian: ca.MX, pairs: Ints) -> tuple[ca.MX, ca.MX, ca.MX, list[ca.MX]]:
    """d and its Jacobian, the directions from the second point to the first (E, 3), and per axis the Jacobian of d times these."""
    take = _difference(x.numel() // 3, pairs[:, 0], pairs[:, 1])
    apart = take @ ca.reshape(x, 3, -1).T
    d = ca.sqrt(ca.sum2(apart**2) + 1e-12)
    unit = apart / ca.repmat(d, 1, 3)
    moved = [take @ jacobian[axis::3, :] for axis in range(3)]
    return d, sum(ca.diag(unit[:, a]) @ moved[a] for a in range(3)), unit, moved


def _touch(stretch: ca.MX, slope: ca.MX, edges: Edges, priority: ca.MX) -> tuple[ca.MX, ca.MX]:
    """√π (d − δ)/τ of the pairs that can touch: by the square, however far apart they still are."""
    rows = edges.touching.tolist()
    root = ca.sqrt(priority)
    return root * stretch[rows], ca.diag(root) @ slope[rows, :]


def _compass(x: ca.MX, jacobian: ca.MX, edges: Edges, u: ca.MX) -> tuple[ca.MX, ca.MX]:
    """√w ((x_a − x_b)/d_ab − u), x, y and z of all lines one after the other."""
    d, slope, unit, moved = _apart(x, jacobian, edges.lines)
    root = ca.DM(np.sqrt(edges.line_weight))
    turned = [ca.diag(root / d) @ (moved[a] - ca.diag(unit[:, a]) @ slope) for a in range(3)]
    missing = ca.diag(root) @ (unit - ca.reshape(u, 3, -1).T)
    return ca.vec(missing), ca.vertcat(*turned)


def _markers(x: ca.MX, jacobian: ca.MX, edges: Edges, r: ca.MX, w: Weights) -> tuple[ca.MX, ca.MX]:
    """√w (R e − r) for the forward and up of every segment."""
    first = len(edges.keypoints)
    origin = np.repeat(first + 3 * np.arange(len(edges.segments)), 2)
    marker = (first + 3 * np.arange(len(edges.segments))[:, None] + [1, 2]).ravel()
    end = np.array([segment.endswith(("foot", "hand")) for segment in edges.segments])
    root = ca.DM(np.repeat(np.sqrt(np.where(end, w.marker / 3, w.marker)), 6))
    take = ca.kron(_difference(x.numel() // 3, marker, origin), ca.DM.eye(3))
    scaled = ca.diag(root / MARKER_ARM) @ take
    return scaled @ x - root * r, scaled @ jacobian


def _path(x: ca.MX, jacobian: ca.MX, match: Match, y: ca.MX, w: Weights) -> tuple[ca.MX, ca.MX]:
    """√w (x_pelvis − y)/ℓ with ℓ the length of a leg, or of all bones where there are none."""
    k = match.index("pelvis") if "pelvis" in match.keypoints else 0
    scale = np.sqrt(w.path) / match.robot_leg
    return (x[3 * k : 3 * k + 3] - y) * scale, jacobian[3 * k : 3 * k + 3, :] * scale


def _rest(robot: Robot, match: Match, edges: Edges, q: ca.MX, w: Weights) -> tuple[ca.MX, ca.MX]:
    """√w (q_joint − standing): decides where no edge does, as about the axis of a straight arm."""
    root = np.sqrt(np.where(_unled(robot, match, edges), w.wrist, w.rest))
    rows = np.zeros((len(robot.joint_ids), robot.model.nv))
    rows[np.arange(len(rows)), robot.dof_index] = root
    hinges = robot.qpos_index
    return ca.DM(root) * (q[hinges.tolist()] - robot.standing()[hinges]), ca.sparsify(ca.DM(rows))


def _unled(robot: Robot, match: Match, edges: Edges) -> np.ndarray:
    """(n,) the wrists without markers: the hinges that move a hand and no other keypoint."""
    moves = carrying(robot.model)[match.points.bodies][:, robot.dof_index]
    hands = {f"{side}_hand" for side in "lr"} & set(match.keypoints) - set(edges.segments)
    return (moves.sum(axis=0) == 1) & moves[[match.index(hand) for hand in hands]].any(axis=0)


def _holds(x: ca.MX, jacobian: ca.MX, wished: _Wished, length: float) -> tuple[ca.MX, ca.MX]:
    """√h (c − p)/ℓ for every coordinate of every sole corner; h is 0 where it is free."""
    root = ca.sqrt(wished.h) / length
    return root * (x - wished.p), ca.diag(root) @ jacobian
