"""Hard edges that a solution does not meet, and the limits that keep it from meeting them."""

from collections.abc import Iterator, Mapping

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import HARD, Track
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solver.honoured import FARTHEST
from robot_retarget.solver.limits import JointBounds
from robot_retarget.solver.problem import EdgeTargets, Problem, targets_of
from robot_retarget.solver.solution import UnmetEdge
from robot_retarget.solver.sqp import FrameSolver

UNMET = 1e-3
"""A hard edge that misses its interval by more is reported [m]."""
PROBE = 1e-5
"""Step of the finite differences of a measure [rad]."""
STATIONARY = 0.01
"""A measure with smaller slopes by all joints does not change [m/rad]."""
AT_BOUND = 1e-3
"""A joint is at its bound within this [rad], a speed within this share of its limit [-], links within this of their margin [m]."""
MATTERS = 0.1
"""A joint is named whose slope is at least this share of the largest [-]."""


def unmet_edges(
    solver: FrameSolver, graph: RobotGraph, measured: Mapping[str, Floats], qpos: Floats
) -> tuple[UnmetEdge, ...]:
    """The hard edges and symbolic inequalities that miss their interval by more than `UNMET`, the largest miss first.

    Args:
        measured: per kind (T, E) values of the edges [m].
        qpos: (T, nq) the solution.
    """
    problem, found = solver.problem, []
    below = problem.inequalities.values(qpos)
    values = {**measured, **{name: below[:, own] for name, own in problem.inequalities.columns.items()}}
    all_targets = targets_of(graph.tracks)
    bounds = problem.limits.bounds(all_targets)
    for track in (graph.kinds[name] for name in values):
        value, hard = values[track.name], track.present & (track.priority >= HARD)
        miss = np.where(hard, np.abs(value - np.clip(value, track.lower, track.upper)), 0.0)
        for edge in np.flatnonzero(miss.max(axis=0, initial=0.0) > UNMET):
            worst, frames = int(miss[:, edge].argmax()), np.flatnonzero(miss[:, edge] > UNMET)
            interval = float(track.lower[worst, edge]), float(track.upper[worst, edge])
            reached = float(value[worst, edge])
            error = reached - float(np.clip(reached, *interval))
            slope = _slope(solver, qpos, worst, track, int(edge))
            away = -np.sign(error) * slope
            reasons = tuple(_reasons(solver, graph.fps, bounds, all_targets.at(worst), qpos, worst, away))
            name, missed = track.edge_name(int(edge)), tuple(frames.tolist())
            unmet = UnmetEdge(track.name, name, missed, worst, reached, *interval, reasons, track.kind.by_user)
            found.append((float(miss[worst, edge]), unmet))
    return tuple(unmet for _, unmet in sorted(found, key=lambda each: -each[0]))


def _reasons(
    solver: FrameSolver, fps: float, bounds: JointBounds, targets: EdgeTargets, qpos: Floats, t: int, away: Floats
) -> Iterator[str]:
    """The limits that are active at a frame and oppose a motion of the hinges (n,) towards an interval."""
    robot = solver.robot
    if np.abs(away).max(initial=0.0) < STATIONARY:
        yield "no joint brings it closer: the distance is at its extremum"
        return
    angles, reach = qpos[:, robot.qpos_index], bounds.speed / fps
    for k in np.argsort(-np.abs(away)):
        if np.abs(away[k]) < MATTERS * np.abs(away).max():
            break
        bound = (bounds.upper if away[k] > 0 else bounds.lower)[t, k]
        if (bound - angles[t, k]) * np.sign(away[k]) < AT_BOUND:
            yield f"{robot.joint_names[k]} is at its joint range ({np.degrees(bound):.0f}°)"
        elif _at_speed(angles, reach, t, int(k), float(np.sign(away[k]))):
            yield f"{robot.joint_names[k]} is at its speed limit ({bounds.speed[t, k]:.1f} rad/s)"
    yield from _links(solver, targets, qpos[t], away)


def _slope(solver: FrameSolver, qpos: Floats, t: int, track: Track, edge: int) -> Floats:
    """(n,) how an edge's measure at a frame changes with the hinges, by central differences."""
    step = np.zeros((len(solver.hinges), solver.robot.model.nv))
    step[np.arange(len(step)), solver.hinges] = PROBE
    probes = integrate(solver.robot, np.tile(qpos[t], (2 * len(step), 1)), np.concatenate([step, -step]))
    ahead, behind = np.split(_measured(solver.problem, track.name, qpos, t, probes)[:, edge], 2)
    return (ahead - behind) / (2 * PROBE)


def _measured(problem: Problem, kind: str, qpos: Floats, t: int, probes: Floats) -> Floats:
    """Return the measures (N, E) of a kind with a frame at some configurations (N, nq) and the others unchanged."""
    if kind in problem.inequalities.columns:
        return problem.inequalities.values(probes)[:, problem.inequalities.columns[kind]]
    joined = [cost for cost in problem.stencils if cost.track.name == kind]
    if joined:
        first = max(t - FARTHEST, 0)
        near = np.repeat(qpos[None, first : t + FARTHEST + 1], len(probes), axis=0)
        near[:, t - first] = probes
        return np.array([joined[0].values(frames)[t - first] for frames in near])
    return problem.values(probes)[:, problem.columns[kind]]


def _at_speed(angles: Floats, reach: Floats, t: int, joint: int, sign: float) -> bool:
    """Whether a joint's speed limit to a neighbour frame keeps it from moving further in a direction."""
    neighbours = [
        (angles[k, joint], reach[own, joint]) for k, own in ((t - 1, t), (t + 1, t + 1)) if 0 <= k < len(angles)
    ]
    return any(sign * (angles[t, joint] - other) > (1 - 10 * AT_BOUND) * most for other, most in neighbours)


def _links(solver: FrameSolver, targets: EdgeTargets, q: Floats, away: Floats) -> Iterator[str]:
    """Pairs of links at their separation margin that a motion of the hinges (n,) brings nearer."""
    near = solver.costs.near(q, targets)
    if near is None:
        return
    opposing = (-near.deficit < AT_BOUND) & (near.slope[:, solver.hinges] @ away < 0)
    ends = [pair for track in solver.problem.tracks for pair in track.ends]
    for a, b in sorted({ends[edge] for edge in near.edges[opposing]}):
        yield f"{a} and {b} are at their separation"
