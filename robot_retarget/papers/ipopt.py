"""IPOPT through CasADi: bones and thresholds as constraints, to rounding; and the relative objective with its kinks.

Soft interval edges carry a variable y within [lower, upper]; a hard edge is a constraint on d = √(‖r‖² + ε²), or
r = 0 where δ = 0. ε = 1e-9 m only keeps the derivative finite where two points coincide.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import GraphError
from robot_retarget.graph.track import LEAST_DISTANCE, Objective, Status
from robot_retarget.papers.edges import BONE, SEPARATION, Edges, PointKind
from robot_retarget.papers.evaluation import box_of, operator, rows
from robot_retarget.papers.points import PointGraph
from robot_retarget.papers.spectral import Minimum

_EPSILON = 1e-9


@dataclass(frozen=True)
class Ipopt:
    """Parameters of the method."""

    hard: Collection[PointKind] = (BONE, SEPARATION)
    """The kinds of edges that become constraints; the others make up the objective."""
    tolerance: float = 1e-10
    """IPOPT's own optimality tolerance."""
    max_iterations: int = 1000
    rounds: int = 10
    """How often the steps ahead of interaction edges are renewed at most; they are constants of each round."""


def constrain(graph: PointGraph, start: Floats, options: Ipopt, objective: Objective) -> Minimum:
    """Minimise the stress of the soft edges from a start (T, V, K) among the realizations that meet the hard ones.

    Args:
        start: (T, V, K) [m].

    Raises:
        GraphError: `RELATIVE` meets a soft interval edge.
    """
    x, history, iterations = start, [], 0
    status, steps = Status.FAILED, _steps(graph, x)
    for _ in range(options.rounds):
        x, status, trace = _solved(graph, x, steps, options, objective)
        history += trace
        iterations += len(trace) - 1
        before, steps = steps, _steps(graph, x)
        if before is None or steps is None or np.array_equal(before, steps):
            break
    return Minimum(x.reshape(-1, 1), np.array(history[-1:]), (status,), (iterations,), tuple(history))


def _solved(
    graph: PointGraph, x: Floats, steps: Floats | None, options: Ipopt, objective: Objective
) -> tuple[Floats, Status, list[float]]:
    """Solve min Σ share(e) over soft edges s.t. lower ≤ d ≤ upper over hard ones and the boxes, from a start.

    Separate variables: y of soft intervals, or |e| of all soft edges under the relative objective.

    Args:
        x: (T, V, K) the start [m].
        steps: (E, 1) steps ahead of interaction edges, None without any.

    Returns:
        The coordinates, the status and the history of the objective.
    """
    import casadi as ca

    edges, hard = graph.edges, [kind.name for kind in options.hard]
    fixed = np.isin(edges.kind, hard) if hard else np.zeros(len(edges), dtype=bool)
    soft = np.flatnonzero(~fixed)
    relative, wide = objective is Objective.RELATIVE, soft[~edges.exact[soft]]
    if relative and wide.size:
        raise GraphError(
            f"edge {edges.name(wide[0])} is a soft interval; under RELATIVE make its kind {edges.kind[wide[0]]} hard, "
            "or use RELATIVE_SQUARED"
        )
    slack = soft if relative else wide
    count = graph.frames * len(graph.vertices)
    points, free = ca.MX.sym("x", graph.dimension, count), ca.MX.sym("y", len(slack))
    r = _differences(graph, points, steps, ca)
    d = ca.sqrt(ca.sum1(r * r).T + _EPSILON**2)
    value, extra = _soft(edges, d, free, soft, slack, objective, ca)
    touching = np.flatnonzero(fixed & (edges.upper == 0))
    apart = np.flatnonzero(fixed & (edges.upper > 0))
    constraints = ca.vertcat(d[apart.tolist()], ca.vec(r[:, touching.tolist()]), extra)
    zeros = np.zeros(len(touching) * graph.dimension)
    below = np.concatenate([edges.lower[apart], zeros, np.zeros(extra.numel())])
    above = np.concatenate([edges.upper[apart], zeros, np.full(extra.numel(), np.inf)])
    problem = {"x": ca.vertcat(ca.vec(points), free), "f": value, "g": constraints}
    solver = ca.nlpsol("dgp", "ipopt", problem, _settings(options))
    lower, upper = box_of(graph, x)
    now, low, high = _measure(graph, x, steps)[slack], edges.lower[slack], edges.upper[slack]
    if relative:
        y, low, high = np.abs(now - low), np.zeros(len(slack)), np.full(len(slack), np.inf)
    else:
        y = np.clip(now, low, high)
    answer = solver(
        x0=np.concatenate([np.clip(x, lower, upper).ravel(), y]),
        lbx=np.concatenate([lower.ravel(), low]),
        ubx=np.concatenate([upper.ravel(), high]),
        lbg=below,
        ubg=above,
    )
    stats = solver.stats()
    found = np.array(answer["x"]).ravel()[: x.size].reshape(x.shape)
    trace = [float(value) for value in stats.get("iterations", {}).get("obj", [float(answer["f"])])]
    return found, _STATUSES.get(stats["return_status"], Status.FAILED), trace


def _differences(graph: PointGraph, points: Any, steps: Floats | None, ca: Any) -> Any:
    """r (K, E) with the steps ahead held."""
    ids, coefficients = operator(graph).members(graph.edges, steps)
    edges, members = ids.shape
    matrix = ca.DM.triplet(
        ids.ravel().tolist(),
        np.repeat(np.arange(edges), members).tolist(),
        ca.DM(coefficients.ravel()),
        graph.frames * len(graph.vertices),
        edges,
    )
    return points @ matrix


def _soft(edges: Edges, d: Any, free: Any, soft: Any, slack: Any, objective: Objective, ca: Any) -> tuple[Any, Any]:
    """The objective, and rows that must be ≥ 0 (|e| as a variable, for the kinks of the relative objective)."""
    priority = ca.DM(edges.priority)
    if objective is Objective.RELATIVE:
        scale = ca.DM(np.maximum(edges.lower, LEAST_DISTANCE))
        chosen = slack.tolist()
        error = d[chosen] - ca.DM(edges.lower[slack])
        return ca.dot(priority[chosen] / scale[chosen], free), ca.vertcat(free - error, free + error)
    target = ca.MX(ca.DM(np.where(np.isinf(edges.upper), edges.lower, edges.upper)))
    if len(slack):
        target[slack.tolist()] = free
    chosen = soft.tolist()
    error, weight = (d - target)[chosen], priority[chosen]
    if objective is Objective.HALF_SQUARED:
        weight = weight / 2
    if objective is Objective.RELATIVE_SQUARED:
        weight = weight / ca.fmax(target[chosen], LEAST_DISTANCE) ** 2
    if np.isfinite(edges.huber_delta[soft]).any():  # 2 g² (root − 1) = 2 e² / (1 + root), and e² for g = ∞
        weight = 2 * weight / (1 + ca.sqrt(1 + (error / ca.DM(edges.huber_delta[soft])) ** 2))
    return ca.dot(weight, error * error), ca.MX(0, 1)


def _measure(graph: PointGraph, x: Floats, steps: Floats | None) -> Floats:
    ids, coefficients = operator(graph).members(graph.edges, steps)
    r = (coefficients[:, :, None] * rows(x)[ids, :, 0]).sum(axis=1)
    return np.linalg.norm(r, axis=1)


def _steps(graph: PointGraph, x: Floats) -> Floats | None:
    k = operator(graph).differences(rows(x))[1]
    return k if k is None else k[:, :1]


def _settings(options: Ipopt) -> dict[str, Any]:
    return {
        "print_time": False,
        "expand": True,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": options.tolerance,
        "ipopt.constr_viol_tol": options.tolerance,
        "ipopt.max_iter": options.max_iterations,
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.acceptable_iter": 0,
    }


_STATUSES = {
    "Solve_Succeeded": Status.CONVERGED,
    "Solved_To_Acceptable_Level": Status.CONVERGED,
    "Maximum_Iterations_Exceeded": Status.OUT_OF_ITERATIONS,
    "Infeasible_Problem_Detected": Status.UNREACHED,
    "Restoration_Failed": Status.UNREACHED,
    "Search_Direction_Becomes_Too_Small": Status.BLOCKED,
}
