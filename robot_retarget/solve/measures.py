"""What edges measure on the robot, and how it changes with the tangent v: CasADi expressions of q alone.

    lengths  ‖x_a − x_b‖ of pairs [m],   directions  (x_a − x_b)/‖x_a − x_b‖ of lines,   R e of markers,
    places of the pelvis and of held corners [m],   angles of the hinges [rad]

one after the other in one vector. A dof that carries both ends leaves a length alone and turns a direction, so that
only those between the two ends take more: most of the Jacobian is zero.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.describe.edges import Edges
from robot_retarget.describe.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import Bodies, carrying
from robot_retarget.solve.footing import sole_corners


@dataclass(frozen=True)
class Measures:
    """Of one robot, one match and one table of edges."""

    values: ca.Function
    """q ↦ all that is measured (M)."""
    slopes: ca.Function
    """q ↦ the same, its Jacobian (M, nv), the heights of the sole points (F) [m] and their Jacobian (F, nv)."""
    heights: ca.Function
    """q ↦ the heights alone."""
    corners: ca.Function
    """q ↦ the corners of the soles, stacked (3 · 4 · feet) [m]."""
    feet: tuple[str, ...]


def build_measures(robot: Robot, match: Match, edges: Edges) -> Measures:
    """Assemble the functions; nothing in them depends on a weight or a wish."""
    bodies, feet = Bodies(robot), tuple(match.anatomy.soles) if robot.root_joints.size else ()
    keypoints = _Keypoints(bodies, match)
    corners = _places(bodies, [sole_corners(match.anatomy, foot) for foot in feet])
    soles, travel = _places(bodies, [match.anatomy.soles[foot] for foot in feet])
    parts = [
        keypoints.lengths(edges.pairs),
        keypoints.directions(edges.lines),
        _markers(bodies, match, edges),
        keypoints.place(match.index("pelvis") if "pelvis" in match.keypoints else 0),
        _angles(robot, bodies),
        corners,
    ]
    values, slopes = (ca.vertcat(*column) for column in zip(*parts, strict=True))
    return Measures(
        bodies.function("values", [values]),
        bodies.function("slopes", [values, slopes, soles[2::3], travel[2::3, :]]),
        bodies.function("heights", [soles[2::3]]),
        bodies.function("corners", [corners[0]]),
        feet,
    )


class _Keypoints:
    """Of a robot; its pelvis is the middle of its hips, as of the human."""

    def __init__(self, bodies: Bodies, match: Match):
        self.bodies, points = bodies, match.points
        mean, carried = _pelvis_between_hips(match), carrying(bodies.model)[points.bodies]
        x = bodies.places(points)
        self.x = x @ ca.sparsify(ca.DM(mean)).T
        self.travel = _stacked(mean) @ bodies.travel(x, carried)
        self.carried = mean @ carried == 1

    def lengths(self, pairs: Ints) -> tuple[Any, Any]:
        """Between keypoints (E, 2) [m], and how they change."""
        length, slope, *_ = self._apart(pairs)
        return length, slope

    def directions(self, lines: Ints) -> tuple[Any, Any]:
        """From the second keypoint to the first (L, 2), x y z one line after the other, and how they turn."""
        length, slope, unit, moved, both = self._apart(lines)
        across = moved - ca.diag(ca.vec(unit)) @ _each_thrice(len(lines)) @ slope
        bent = ca.diag(_each_thrice(len(lines)) @ (1 / length)) @ across
        return ca.vec(unit), bent + self.bodies.turning(unit, both)

    def place(self, keypoint: int) -> tuple[Any, Any]:
        """Where a keypoint is [m]."""
        return self.x[:, keypoint], self.travel[3 * keypoint : 3 * keypoint + 3, :]

    def _apart(self, pairs: Ints) -> tuple[Any, Any, Any, Any, np.ndarray]:
        """Lengths (N), slopes (N, nv) and directions (3, N), how dofs between the ends move these apart (3N, nv), and
        which dofs carry both ends (N, nv).
        """
        one, other = pairs.T
        apart = self.x[:, one.tolist()] - self.x[:, other.tolist()]
        length = ca.sqrt(ca.sum1(apart**2).T + 1e-12)  # smooth where two keypoints meet
        unit = apart @ ca.diag(1 / length)
        both = self.carried[one] & self.carried[other]
        between = ca.sparsify(ca.DM(np.repeat(~both, 3, axis=0).astype(float)))
        moved = (_stacked(_differences(len(self.carried), pairs)) @ self.travel) * between
        return length, _each_thrice(len(pairs)).T @ (ca.diag(ca.vec(unit)) @ moved), unit, moved, both


def _markers(bodies: Bodies, match: Match, edges: Edges) -> tuple[Any, Any]:
    """Forward and up of every segment."""
    frames = [match.anatomy.frames[segment] for segment in edges.segments]
    own = np.repeat(np.array([body for body, _ in frames], int), 2)
    vectors = np.array([axes[:, k] for _, axes in frames for k in (0, 2)]).reshape(-1, 3)
    e = bodies.directions(own, vectors)
    return ca.vec(e), bodies.turning(e, carrying(bodies.model)[own])


def _angles(robot: Robot, bodies: Bodies) -> tuple[Any, Any]:
    """The hinges' [rad]."""
    chosen = np.eye(robot.model.nv)[robot.dof_index]
    return bodies.q[robot.qpos_index.tolist()], ca.SX(ca.sparsify(ca.DM(chosen)))


def _places(bodies: Bodies, groups: list[Points]) -> tuple[Any, Any]:
    """Where all points of some groups are, x y z one after the other [m]."""
    own = np.concatenate([np.zeros(0, int), *(points.bodies for points in groups)])
    x = bodies.places(Points(own, np.concatenate([np.zeros((0, 3)), *(points.offsets for points in groups)])))
    return ca.vec(x), bodies.travel(x, carrying(bodies.model)[own])


def _pelvis_between_hips(match: Match) -> Floats:
    """(K, K) that leaves keypoints as they are, but for the pelvis: the middle of the hips."""
    mean = np.eye(len(match.keypoints))
    if {"pelvis", "l_hip", "r_hip"} <= set(match.keypoints):
        mean[match.index("pelvis")] = mean[[match.index("l_hip"), match.index("r_hip")]].mean(axis=0)
    return mean


def _differences(count: int, pairs: Ints) -> Floats:
    """(N, P) that takes points to the first of a pair less the second."""
    return np.eye(count)[pairs[:, 0]] - np.eye(count)[pairs[:, 1]]


def _stacked(matrix: Floats) -> ca.DM:
    """A matrix for points, for their coordinates."""
    return ca.kron(ca.sparsify(ca.DM(matrix)), ca.DM.eye(3))


def _each_thrice(count: int) -> ca.DM:
    """(3N, N) that repeats numbers."""
    return ca.kron(ca.DM.eye(count), ca.DM.ones(3, 1))
