"""One frame of a graph as CasADi functions: edges through forward kinematics to a quadratic model in the tangent v.

    minimise  Σ π ϱ((d(q ⊕ v) − y)/scale)    subject to    z_sole(q ⊕ v) ≥ 0

over the edges of all kinds (`graph.track`), with y the point of [lower, upper] nearest to d. J is the Jacobian of
the measures, r = d − y the residuals and w = π/scale² · ϱ'(e)/2e the weights (iteratively reweighted least squares,
whose model lies above ϱ everywhere). The model is  cost + 2 (Jᵀ W r)·v + vᵀ (Jᵀ W J) v.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_retarget.base.arrays import Floats, Ints, as_slice
from robot_retarget.base.errors import GraphError, known
from robot_retarget.graph.kind import Kind
from robot_retarget.graph.kinds import KINDS
from robot_retarget.graph.symbolic_robot import SymbolicRobot
from robot_retarget.graph.track import (
    CAUSAL_DIFFERENCE,
    FRAME,
    HARD,
    SECOND_DIFFERENCE,
    STEP,
    THIRD_DIFFERENCE,
    Form,
    Role,
    Track,
    columns_of,
    frame_costs,
    ordered,
)
from robot_retarget.human.match import Match
from robot_retarget.robot import Robot
from robot_retarget.robot.kinematics import tangent_names
from robot_retarget.solver.compiled import Build, Upgraded
from robot_retarget.solver.limits import ConstantLimits, JointLimits, Targets
from robot_retarget.solver.native import build_key

UNREACHED = 0.0125
"""A hard edge that misses its interval by more is out of reach, over the leg [-]: by 2.8 mm on the OP3, 8 mm on the G1."""

EASED = 100.0
"""π of a hard edge of a user while footholds are placed, over the squared leg [-], as in `with_edge`: that of a soft edge of theirs."""

# Which kinds a solver can honour; any other is an error, never a row that is ignored.


def require_honoured(robot: Robot, tracks: Sequence[Track], lag: int | None) -> None:
    """Raise for the first kind with rows that the solver of a clip, or of a stream, cannot honour.

    Args:
        tracks: all tracks of a graph.
        lag: number of frames by which a stream lags; None for a clip.

    Raises:
        GraphError: the message names the kind, its role and its stencil, and the combinations that the solver honours.
    """
    require_kinds([track.kind for track in tracks], lag)
    for track in tracks:
        if reason := _values_refused(track, robot):
            raise GraphError(f"{_title(track.kind)}: {reason}")


def require_kinds(kinds: Sequence[Kind], lag: int | None) -> None:
    """Raise for the first kind with a role, form and stencil that the solver of a clip, or of a stream, cannot honour.

    Args:
        kinds: all kinds of a graph.
        lag: number of frames by which a stream lags; None for a clip.

    Raises:
        GraphError: as `require_honoured`.
    """
    repeated = [name for name, count in Counter(kind.name for kind in kinds).items() if count > 1]
    if repeated:
        raise GraphError(f"two kinds of edges have the name {repeated[0]!r}")
    for kind in kinds:
        if reason := _stencil_refused(kind, lag):
            raise GraphError(f"{_title(kind)}: {reason}")


def _title(kind: Kind) -> str:
    return f"kind {kind.name!r}, {kind.form.value} {kind.role.value} with the stencil {_written(kind.stencil)}"


def _written(stencil: tuple[int, ...]) -> str:
    return str(stencil).replace("-", "−")


def _stencil_refused(kind: Kind, lag: int | None) -> str:
    """Return why the solver cannot honour the role, form and stencil of a kind; empty if it can."""
    honoured = {
        (Role.COST, Form.SYMBOLIC): (FRAME,),
        (Role.COST, Form.NUMERIC): (FRAME,),
        (Role.COST, Form.JOINT): _differences(lag),
        (Role.INEQUALITY, Form.SYMBOLIC): (FRAME,),
        (Role.INEQUALITY, Form.NUMERIC): (FRAME,),
        (Role.BOUND, Form.JOINT): (FRAME, STEP),
    }.get((kind.role, kind.form), ())
    if not honoured:
        return "bounds have the joint form, inequalities the symbolic or numeric one"
    listed = " or ".join(_written(each) for each in honoured)
    driver = "a clip" if lag is None else "a stream"
    return "" if kind.stencil in honoured else f"the solver of {driver} honours {listed}"


def _differences(lag: int | None) -> tuple[tuple[int, ...], ...]:
    """Return the stencils of differences of joints that a clip or a stream honours."""
    smooth = (SECOND_DIFFERENCE, THIRD_DIFFERENCE)
    if lag is None:
        return smooth
    return (CAUSAL_DIFFERENCE, *smooth) if lag else (CAUSAL_DIFFERENCE,)


def _values_refused(track: Track, robot: Robot) -> str:
    """Return why the solver cannot honour the targets or ends of a track; empty if it can."""
    if track.role is not Role.COST and np.isfinite(track.priority[track.priority > 0]).any():
        return "limits have the priority ∞ where they hold and 0 elsewhere"
    if (track.role, track.kind.form) == (Role.INEQUALITY, Form.NUMERIC) and np.isfinite(track.upper).any():
        return "surfaces have no upper bound"
    if track.kind.form is not Form.JOINT:
        return ""
    names = robot.joint_names if track.role is Role.BOUND else tangent_names(robot)
    ends = Counter(end for end, _ in track.ends)
    for end, count in ends.items():
        if end not in names or count > 1:
            return f"joint {end!r} has two edges" if end in names else f"no joint {end!r}; {known(names)}"
    if track.role is not Role.COST:
        return ""
    if not (np.isinf(track.huber_delta) and track.exact):
        return "differences of joints have one target and squared errors"
    moved = track.stencil == CAUSAL_DIFFERENCE and track.lower.any()
    return "differences from the two frames before have the target 0" if moved else ""


class CompiledTracks:
    """Some of a graph's tracks, side by side, as compiled functions."""

    model: Upgraded
    cost: Upgraded
    values: Upgraded

    def __init__(self, robot: Robot, match: Match, tracks: Sequence[Track], first: int, native: bool, shipped: bool):
        """Assemble the functions of tracks whose edges begin with the graph's `first`."""
        self.edges: slice = slice(first, first + sum(map(len, tracks)))
        key = build_key(robot, match, tracks) if shipped else None
        self.build: Build = Build(lambda: _cost_functions(robot, match, tracks, shipped), key, native)
        self.model, self.cost, self.values = self.build.functions

    def of(self, targets: Targets) -> tuple[Floats, Floats, Floats]:
        """Return lower bounds, upper bounds and priorities of these edges."""
        return targets.lower[..., self.edges], targets.upper[..., self.edges], targets.priority[..., self.edges]


def _cost_functions(robot: Robot, match: Match, tracks: Sequence[Track], shipped: bool) -> list[ca.Function]:
    """Return quadratic model, cost and measures of tracks as functions of q and of targets."""
    body = SymbolicRobot(robot, match)
    found = body.resolved([track.kind.measure(track, body) for track in tracks])
    terms, q = _Terms(tracks, found.rows, shipped), body.bodies.q
    targets = [ca.MX.sym(name, terms.edges) for name in ("lower", "upper", "priority")]
    at, measure = ca.MX.sym("q", robot.model.nq), ca.Function("measure", [q], [found.values])
    model = terms.model(ca.Function("slopes", [q], [found.values, found.slopes]), at, targets)
    cost = ca.Function("cost", [at, *targets], [ca.densify(terms.around(measure(at), *targets)[0])])
    values = ca.Function("values", [at], [ca.densify(ca.vec(measure(at)[found.rows.tolist()]))])
    return [model, cost, values]


@dataclass(frozen=True, eq=False)
class Problem:
    """The compiled problem of one robot and the edges of a graph; it holds neither frames nor state."""

    robot: Robot
    match: Match
    tracks: tuple[Track, ...]
    """All tracks of the graph in the order of `track.ordered`; their targets are parameters."""
    parts: tuple[CompiledTracks, ...]
    inequalities: "Inequalities"
    streams: bool = False
    """Whether frames come one by one: edges that do not follow the human keep their targets."""

    @cached_property
    def columns(self) -> dict[str, slice]:
        """The edges of each kind in targets."""
        return columns_of(self.tracks)

    @cached_property
    def limits(self) -> JointLimits:
        """The rows of joint coordinates."""
        vary = any(t.kind.follows_human for t in self.tracks if t.role is Role.BOUND or t.kind.form is Form.JOINT)
        limits = ConstantLimits if self.streams and not vary else JointLimits
        return limits(self.robot, self.tracks, self.columns)

    @property
    def leg(self) -> float:
        """Length of the robot's leg [m]."""
        return self.match.robot_leg

    @property
    def native(self) -> bool:
        """Whether machine code evaluates every part."""
        return all(part.build.native for part in self.parts)

    def wait(self) -> None:
        """Wait until the machine code is ready or cannot be compiled."""
        for part in (*self.parts, self.inequalities):
            part.build.wait()

    def model(self, q: Floats, targets: Targets, threads: int = 1) -> tuple[Floats, Floats, Floats]:
        """The cost at configurations (…, nq), gradient (…, nv) and normal matrix (…, nv, nv)."""
        found = [part.model(q, *part.of(targets), threads=threads) for part in self.parts]
        (cost, gradient, normal), *others = found
        for more in others:
            cost, gradient, normal = cost + more[0], gradient + more[1], normal + more[2]
        return cost[..., 0], gradient, normal

    def cost(self, q: Floats, targets: Targets) -> Floats:
        """The first of these alone (…)."""
        return np.sum([part.cost(q, *part.of(targets))[0][..., 0] for part in self.parts], axis=0)

    def missed(self, q: Floats, targets: Targets) -> Floats:
        """Return (…) the largest distance of a hard edge from its interval [m]; 0 without hard edges."""
        d = self.values(q)
        lower, upper, priority = (side[..., : d.shape[-1]] for side in (targets.lower, targets.upper, targets.priority))
        return np.where(priority >= HARD, np.abs(d - np.clip(d, lower, upper)), 0.0).max(axis=-1, initial=0.0)

    def eased(self, targets: Targets) -> Targets:
        """Return the targets with hard edges of a user as soft ones: where they are out of reach, they would drag the feet."""
        priority, own = targets.priority.copy(), self.by_user
        priority[:, own] = np.minimum(priority[:, own], EASED)
        return replace(targets, priority=priority)

    def within_reach(self, q: Floats, targets: Targets) -> Targets:
        """Return the targets with a user's edges that q (T, nq) misses moved towards their measures.

        None pulls harder than a hard edge that misses by `UNREACHED`.
        """
        own, lower, upper = self.by_user, targets.lower.copy(), targets.upper.copy()
        d, most = self.values(q)[:, own], UNREACHED * self.leg * HARD / np.maximum(targets.priority[:, own], 1.0)
        lower[:, own], upper[:, own] = np.minimum(lower[:, own], d + most), np.maximum(upper[:, own], d - most)
        return replace(targets, lower=lower, upper=upper)

    @cached_property
    def by_user(self) -> Ints:
        """The edges that a user added among the symbolic costs."""
        costs = [track for track in frame_costs(self.tracks) if track.kind.by_user]
        return np.concatenate([np.zeros(0, int), *(np.r_[self.columns[track.name]] for track in costs)]).astype(int)

    def values(self, q: Floats) -> Floats:
        """Return the measures (…, E) of the symbolic costs of one frame, which are the first edges."""
        return np.concatenate([part.values(q)[0] for part in self.parts], axis=-1)


class Inequalities:
    """Symbolic inequalities as compiled rows  J v ≥ deficit; an upper bound is a row of opposite sign."""

    def __init__(self, robot: Robot, match: Match, tracks: Sequence[Track], native: bool):
        """Compile the rows of a problem's tracks, which are `ordered`."""
        own = [track for track in tracks if (track.role, track.kind.form) == (Role.INEQUALITY, Form.SYMBOLIC)]
        self._nv, every = robot.model.nv, columns_of(tracks)
        build, key = (lambda: [_row_function(robot, match, own)]), build_key(robot, match, own)
        self.build = Build(build, key, native)
        (self._measure,) = self.build.functions
        self.columns: dict[str, slice] = columns_of(own)
        """The edges of each kind among these rows."""
        own_edges = [edge for t in own for edge in range(every[t.name].start, every[t.name].stop)]
        self.edges: Ints | slice = as_slice(np.array(own_edges, dtype=int))
        self.below: Ints = _where([np.isfinite(t.lower).any(axis=0) | t.kind.follows_human for t in own])
        """The edges among these that have a lower bound: the first rows."""
        self._above = _where([np.isfinite(t.upper).any(axis=0) | t.kind.follows_human for t in own])
        self._raising: Ints | slice = as_slice(_where([np.full(len(t), t.kind.raises_root) for t in own]))
        self._rows: Ints | slice = as_slice(self.below)

    def __len__(self) -> int:
        return len(self.below) + len(self._above)

    def rows(self, q: Floats, targets: Targets) -> tuple[Floats, Floats]:
        """Return slopes (…, R, nv) and deficits (…, R), bound minus value, at configurations (…, nq)."""
        values, slopes = self._measure(q)
        slopes, lower = slopes.reshape(*values.shape, self._nv), targets.lower[..., self.edges]
        below = slopes[..., self._rows, :], (lower - values)[..., self._rows]
        if not self._above.size:
            return below
        above = -slopes[..., self._above, :], (values - targets.upper[..., self.edges])[..., self._above]
        return np.concatenate([below[0], above[0]], axis=-2), np.concatenate([below[1], above[1]], axis=-1)

    def values(self, q: Floats) -> Floats:
        """Return the measures (…, E) of the edges at configurations (…, nq)."""
        return self._measure(q)[0]

    def depth(self, q: Floats, targets: Targets) -> Floats:
        """Return (…) by how much the root must rise to meet the kinds that raise it [m]."""
        own, raising = targets.lower[..., self.edges], self._raising
        return (own - self._measure(q)[0])[..., raising].max(axis=-1, initial=0.0)


def _row_function(robot: Robot, match: Match, tracks: Sequence[Track]) -> ca.Function:
    """Return the measures of inequalities and their slopes as a function of q."""
    body = SymbolicRobot(robot, match)
    found = body.resolved([track.kind.measure(track, body) for track in tracks])
    rows = found.rows.tolist()
    values, slopes = ca.vec(found.values[rows]), ca.densify(found.slopes[rows, :])
    return ca.Function("inequalities", [body.bodies.q], [ca.densify(values), slopes])


def _where(chosen: Sequence[Any]) -> Ints:
    """Return the indices of the edges chosen by the masks of consecutive tracks."""
    return np.flatnonzero(np.concatenate([np.zeros(0, bool), *chosen]))


def build_problem(
    robot: Robot, match: Match, tracks: Sequence[Track], native: bool = False, *, lag: int | None = None
) -> Problem:
    """Assemble the functions for a robot; targets stay parameters.

    The kinds that describe every motion are one part. Each other kind is a separate part, so an edge that a user adds
    leaves the compiled rest unchanged.

    Args:
        native: use machine code as soon as it is ready (`native.py`); before that, and without a compiler, CasADi's
            virtual machine gives the same results.
        lag: number of frames by which a stream lags; None for a clip.

    Raises:
        GraphError: a kind has a role, form and stencil that the solver cannot honour.
    """
    require_honoured(robot, tracks, lag)
    tracks = ordered(tracks)
    common, costs = {kind.name for kind in KINDS}, frame_costs(tracks)
    groups = [[track for track in costs if track.name in common]]
    groups += [[track] for track in costs if track.name not in common]
    parts, columns = [], columns_of(tracks)
    for group in groups:
        if group:
            first, shipped = columns[group[0].name].start, group is groups[0]
            parts.append(CompiledTracks(robot, match, group, first, native and shipped, shipped))
    inequalities = Inequalities(robot, match, tracks, native)
    return Problem(robot, match, tracks, tuple(parts), inequalities, lag is not None)


class _Terms:
    """The summed cost terms, as expressions of the measures."""

    edges: int
    rows: Ints

    def __init__(self, tracks: Sequence[Track], rows: Ints, shipped: bool):
        """Sum the terms of tracks; those of shipped kinds keep targets of single values, as they have them now."""
        self.edges, self.rows = len(rows), rows
        self.scale: Floats = np.concatenate([track.scale for track in tracks])
        self.huber_delta: Floats = np.concatenate([np.full(len(track), track.huber_delta) for track in tracks])
        self.open: list[int] = np.flatnonzero(
            np.concatenate([np.full(len(track), not (shipped and track.exact)) for track in tracks])
        ).tolist()
        self.gather: ca.DM = ca.sparsify(ca.DM(np.eye(int(rows.max(initial=-1)) + 1)[rows].T))
        """(M, E) matrix that sums edges over the rows they share."""

    def around(self, values: ca.MX, lower: ca.MX, upper: ca.MX, priority: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        """Return the cost, and per row the sum of weighted residuals and the sum of weights."""
        d = ca.vec(values[self.rows.tolist()])  # of a single row, indexing makes a row vector
        residual, weight = d - lower, priority / self.scale**2
        if self.open:
            low, high, own = lower[self.open], upper[self.open], d[self.open]
            residual[self.open] = ca.fmin(own - low, 0) + ca.fmax(own - high, 0)
            weight[self.open] *= 1 - ca.logic_and(own > low, own < high)
        soft = np.flatnonzero(np.isfinite(self.huber_delta)).tolist()
        stiff = np.flatnonzero(~np.isfinite(self.huber_delta)).tolist()
        cost = ca.dot(weight[stiff], residual[stiff] ** 2)
        if soft:
            huber_delta = ca.DM(self.huber_delta[soft])
            root = ca.sqrt(1 + (residual[soft] / (self.scale[soft] * self.huber_delta[soft])) ** 2)
            cost += ca.dot(2 * huber_delta**2 * priority[soft], root - 1)
            weight[soft] /= root
        return cost, self.gather @ (weight * residual), self.gather @ weight

    def model(self, slopes: ca.Function, q: ca.MX, targets: list[ca.MX]) -> ca.Function:
        """(q, lower, upper, π) ↦ cost, gradient (nv) and normal matrix (nv, nv)."""
        values, jacobian = slopes(q)
        cost, pull, weight = self.around(values, *targets)
        normal = ca.triu2symm(ca.triu(jacobian.T @ (ca.diag(weight) @ jacobian)))
        return ca.Function("model", [q, *targets], [ca.densify(each) for each in (cost, jacobian.T @ pull, normal)])
