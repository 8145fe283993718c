"""A robot as kinds of edges see it: symbols for the points, axes and joints that they measure.

A kind writes its measure in these symbols and CasADi differentiates it by them. The derivatives of the symbols by the
joints are common to all kinds (`robot.kinematics`). The product of the two is the Jacobian by the tangent vector v.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import GraphError, known
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import Bodies, carrying, mass_shares
from robot_retarget.robot.support import CORNER_NAMES, sole_corners

COMPARED = 6
"""Number of configurations at which entries must agree to count as the same: half and double find the same entries on
the OP3 and the G1."""
Key = tuple[str | float, ...]
"""Name of a symbol, and the numbers that place it: a point, an axis, the hinges or the centre of mass."""
COMPARED_DIGITS = 11
"""Entries that agree at all of those to this number of decimals are equal, or zero: 13 and 14 find the same on the OP3
and the G1, 8 drops 35 of 2102 slopes on the G1."""


@dataclass(frozen=True)
class Expressions:
    """Measures as expressions of q; edges with the same measure share a row."""

    values: ca.SX
    """(M,)."""
    slopes: ca.SX
    """(M, nv) their Jacobian by v, sparse."""
    rows: Ints
    """(E,) the row of every edge."""


class SymbolicRobot:
    """The points, axes and joints of one robot; each is a symbol until `resolved`."""

    robot: Robot
    match: Match
    bodies: Bodies

    def __init__(self, robot: Robot, match: Match):
        self.robot, self.match, self.bodies = robot, match, Bodies(robot)
        self._carried = carrying(robot.model)
        self._symbols: dict[Key, ca.SX] = {}
        self._places: dict[Key, tuple[ca.SX, ca.SX]] = {}
        """The symbols as expressions of q, and their Jacobians by v."""

    def keypoint(self, name: str) -> ca.SX:
        """Return (3,) the position of a keypoint [m]; the pelvis is the middle of the hips, as for the human.

        Raises:
            GraphError: the bodies do not share this keypoint.
        """
        sites = self.match.anatomy.sites
        if name == "pelvis" and {"l_hip", "r_hip"} <= set(self.match.keypoints):
            return (self.keypoint("l_hip") + self.keypoint("r_hip")) / 2
        if name not in self.match.keypoints:
            raise GraphError(f"no keypoint {name!r}; {known(self.match.keypoints)}")
        return self.point(sites[name].body, sites[name].offset)

    def point(self, body: int, offset: Floats) -> ca.SX:
        """Return (3,) the position of a point fixed to a body [m].

        Args:
            body: id of a body.
            offset: (3,) in its frame [m].
        """

        def found() -> tuple[ca.SX, ca.SX]:
            x = self.bodies.places(Points(np.array([body]), np.asarray(offset)))
            return x, self.bodies.travel(x, self._carried[[body]])

        return self._symbol(("point", body, *np.asarray(offset, dtype=float).tolist()), found)

    def axis(self, body: int, vector: Floats) -> ca.SX:
        """Return (3,) the direction of a unit vector fixed to a body.

        Args:
            body: id of a body.
            vector: (3,) unit vector in its frame.
        """

        def found() -> tuple[ca.SX, ca.SX]:
            e = self.bodies.directions(np.array([body]), np.asarray(vector)[None])
            return e, self.bodies.turning(e, self._carried[[body]])

        return self._symbol(("axis", body, *np.asarray(vector, dtype=float).tolist()), found)

    def corners(self, foot: str) -> list[ca.SX]:
        """Return the corners of a sole, each (3,) [m], in the order of `CORNER_NAMES`."""
        points = sole_corners(self.match.anatomy, foot)
        body = int(points.bodies[0])
        return [self.point(body, offset) for offset in points.offsets[: len(CORNER_NAMES)]]

    def angles(self) -> ca.SX:
        """Return (n,) angles of the hinges [rad]."""

        def found() -> tuple[ca.SX, ca.SX]:
            rows = np.eye(self.robot.model.nv)[self.robot.dof_index]
            return self.bodies.q[self.robot.qpos_index.tolist()], ca.SX(ca.sparsify(ca.DM(rows)))

        return self._symbol(("angles",), found)

    def mass(self) -> ca.SX:
        """Return (3,) the centre of mass [m]."""
        return self._symbol(("mass",), lambda: mass_shares(self.robot, self.bodies))

    def resolved(self, measures: Sequence[ca.SX]) -> Expressions:
        """Return all measures (E,) as expressions of q, and their Jacobian by v without entries that always vanish.

        A distance does not change with a joint that carries both its ends, and touch has the measures of posture.
        Evaluation at drawn configurations finds such zeros and repetitions.
        """
        measured = ca.vertcat(ca.SX(0, 1), *measures)
        symbols = ca.vertcat(ca.SX(0, 1), *self._symbols.values())
        values = ca.vertcat(ca.SX(0, 1), *(x for x, _ in self._places.values()))
        travels = ca.vertcat(ca.SX(0, self.robot.model.nv), *(travel for _, travel in self._places.values()))
        together = ca.Function("together", [symbols], [measured, ca.jacobian(measured, symbols)])
        value, by_points = together(values)
        drawn = drawn_configurations(self.robot, COMPARED)
        first, rows = _repeated(ca.Function("values", [self.bodies.q], [value]), drawn)
        slopes = by_points[first, :] @ travels
        return Expressions(
            value[first], _without_zeros(ca.Function("slopes", [self.bodies.q], [slopes]), slopes, drawn), rows
        )

    def _symbol(self, key: Key, found: Callable[[], tuple[ca.SX, ca.SX]]) -> ca.SX:
        if key not in self._places:
            value, travel = found()
            self._places[key] = ca.vec(value), travel
            self._symbols[key] = ca.SX.sym(str(key[0]), value.numel())
        return self._symbols[key]


def _repeated(evaluate: ca.Function, drawn: Floats) -> tuple[list[int], Ints]:
    """Return the first of every set of equal values at drawn configurations, in order, and the set of every value."""
    seen = np.round(np.stack([evaluate(qpos).full().ravel() for qpos in drawn], axis=1), COMPARED_DIGITS)
    _, first, inverse = np.unique(seen, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return first[order].tolist(), rank[inverse.ravel()]


def _without_zeros(evaluate: ca.Function, slopes: ca.SX, drawn: Floats) -> ca.SX:
    """Return the Jacobian with the pattern of the entries that do not vanish at drawn configurations."""
    seen = np.max([np.abs(evaluate(qpos).full()) for qpos in drawn], axis=0, initial=0.0)
    return ca.project(slopes, ca.sparsify(ca.DM(np.round(seen, COMPARED_DIGITS) > 0)).sparsity())


def drawn_configurations(robot: Robot, count: int) -> Floats:
    """Return (count, nq) configurations drawn from the joint ranges with any root pose; every call returns the same.

    Args:
        count: number of configurations.
    """
    draw = np.random.default_rng(0)
    qpos = np.tile(robot.neutral(), (count, 1))
    qpos[:, robot.qpos_index] = draw.uniform(robot.lower, robot.upper, (count, len(robot.lower)))
    for joint in robot.root_joints[: 0 if robot.floating else None]:
        qpos[:, robot.model.jnt_qposadr[joint]] = draw.normal(size=count)
    if robot.floating:
        a = robot.root_address
        qpos[:, a : a + 3] = draw.normal(size=(count, 3))
        turn = draw.normal(size=(count, 4))
        qpos[:, a + 3 : a + 7] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    return qpos
