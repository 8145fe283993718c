"""A robot as kinds of edges see it: symbols for the points, axes and joints that they ask for.

A kind writes its measure in these symbols and CasADi differentiates it by them; how they move with the joints is known
once for all (`robot.kinematics`). The product of the two is the Jacobian by the tangent vector v.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.arrays import Floats, Ints
from robot_retarget.describe.soles import CORNER_NAMES, sole_corners
from robot_retarget.errors import GraphError, known
from robot_retarget.human.match import Match
from robot_retarget.robot import Points, Robot
from robot_retarget.robot.kinematics import Bodies, carrying, mass_shares

SAMPLES = 6
"""Configurations at which entries have to agree to be taken for the same."""
DIGITS = 11
"""Entries are equal, or zero, that agree at all of those so far behind the point."""


@dataclass(frozen=True)
class Expressions:
    """What was measured, as expressions of q; edges that measure the same share a row."""

    values: Any
    """(M,)."""
    slopes: Any
    """(M, nv) their Jacobian by v, sparse."""
    rows: Ints
    """(E,) the row of every edge."""


class Measured:
    """The points, axes and joints of one robot; each is a symbol until `resolved`."""

    def __init__(self, robot: Robot, match: Match):
        self.robot, self.match, self.bodies = robot, match, Bodies(robot)
        self._carried = carrying(robot.model)
        self._symbols: dict[tuple[Any, ...], Any] = {}
        self._values: list[Any] = []
        self._travels: list[Any] = []

    def keypoint(self, name: str) -> Any:
        """(3,) where a keypoint is [m]; the pelvis is the middle of the hips, as of the human.

        Raises:
            GraphError: the bodies do not share it.
        """
        spots = self.match.anatomy.spots
        if name == "pelvis" and {"l_hip", "r_hip"} <= set(self.match.keypoints):
            return (self.keypoint("l_hip") + self.keypoint("r_hip")) / 2
        if name not in self.match.keypoints:
            raise GraphError(f"no keypoint {name!r}; {known(self.match.keypoints)}")
        return self.point(spots[name].body, spots[name].offset)

    def point(self, body: int, offset: Floats) -> Any:
        """(3,) where a point fixed to a body is [m]."""

        def found() -> tuple[Any, Any]:
            x = self.bodies.places(Points(np.array([body]), np.asarray(offset)))
            return x, self.bodies.travel(x, self._carried[[body]])

        return self._symbol(("point", body, *np.asarray(offset, dtype=float).tolist()), found)

    def axis(self, body: int, vector: Floats) -> Any:
        """(3,) how a unit vector fixed to a body points."""

        def found() -> tuple[Any, Any]:
            e = self.bodies.directions(np.array([body]), np.asarray(vector)[None])
            return e, self.bodies.turning(e, self._carried[[body]])

        return self._symbol(("axis", body, *np.asarray(vector, dtype=float).tolist()), found)

    def corners(self, foot: str) -> list[Any]:
        """The corners of a sole, each (3,) [m], in the order of `CORNER_NAMES`."""
        points = sole_corners(self.match.anatomy, foot)
        body = int(points.bodies[0])
        return [self.point(body, offset) for offset in points.offsets[: len(CORNER_NAMES)]]

    def angles(self) -> Any:
        """(n,) of the hinges [rad]."""

        def found() -> tuple[Any, Any]:
            rows = np.eye(self.robot.model.nv)[self.robot.dof_index]
            return self.bodies.q[self.robot.qpos_index.tolist()], ca.SX(ca.sparsify(ca.DM(rows)))

        return self._symbol(("angles",), found)

    def mass(self) -> Any:
        """(3,) the centre of mass [m]."""
        return self._symbol(("mass",), lambda: mass_shares(self.robot, self.bodies))

    def resolved(self, measures: Sequence[Any]) -> Expressions:
        """Measures (E,) in all, as expressions of q, and their Jacobian by v without the entries that always vanish.

        A distance does not change with a joint that carries both its ends, and touch measures what posture does: such zeros
        and repetitions are found by looking, at some drawn configurations.
        """
        measured = ca.vertcat(ca.SX(0, 1), *measures)
        symbols = ca.vertcat(ca.SX(0, 1), *self._symbols.values())
        values, travels = ca.vertcat(ca.SX(0, 1), *self._values), ca.vertcat(*self._travels)
        together = ca.Function("together", [symbols], [measured, ca.jacobian(measured, symbols)])
        value, by_points = together(values)
        drawn = drawn_configurations(self.robot, SAMPLES)
        first, rows = _repeated(ca.Function("values", [self.bodies.q], [value]), drawn)
        slopes = by_points[first, :] @ travels
        return Expressions(
            value[first], _without_zeros(ca.Function("slopes", [self.bodies.q], [slopes]), slopes, drawn), rows
        )

    def _symbol(self, key: tuple[Any, ...], found: Any) -> Any:
        if key not in self._symbols:
            value, travel = found()
            self._symbols[key] = ca.SX.sym(str(key[0]), value.numel())
            self._values.append(ca.vec(value))
            self._travels.append(travel)
        return self._symbols[key]


def _repeated(evaluate: ca.Function, drawn: Floats) -> tuple[list[int], Ints]:
    """The first of every set of equal values at drawn configurations, in order, and the set of every value."""
    seen = np.round(np.stack([evaluate(qpos).full().ravel() for qpos in drawn], axis=1), DIGITS)
    _, first, inverse = np.unique(seen, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return first[order].tolist(), rank[inverse.ravel()]


def _without_zeros(evaluate: ca.Function, slopes: Any, drawn: Floats) -> Any:
    """The Jacobian with the pattern of the entries that do not vanish at drawn configurations."""
    seen = np.max([np.abs(evaluate(qpos).full()) for qpos in drawn], axis=0, initial=0.0)
    return ca.project(slopes, ca.sparsify(ca.DM((seen > 10.0**-DIGITS).astype(float))).sparsity())


def drawn_configurations(robot: Robot, count: int) -> Floats:
    """(count, nq) drawn from the joint ranges, the root anywhere; always the same."""
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
