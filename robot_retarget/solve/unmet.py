"""Hard edges that a solution does not meet, and the limits that keep it from meeting them."""

from collections.abc import Iterator, Mapping

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.graph.track import HARD
from robot_retarget.robot.kinematics import integrate
from robot_retarget.solve.solution import UnmetEdge
from robot_retarget.solve.sqp import FrameSolver

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
    """The hard edges of all kinds that miss their interval by more than `UNMET`, the largest miss first.

    Args:
        measured: per kind (T, E) values of the edges [m].
        qpos: (T, nq) the solution.
    """
    found, first = [], 0
    for track in graph.costs:
        value = measured[track.name]
        miss = np.where(track.priority >= HARD, np.abs(value - np.clip(value, track.lower, track.upper)), 0.0)
        for edge in np.flatnonzero(miss.max(axis=0, initial=0.0) > UNMET):
            frames = np.flatnonzero(miss[:, edge] > UNMET)
            worst = int(miss[:, edge].argmax())
            bounds = float(track.lower[worst, edge]), float(track.upper[worst, edge])
            reached = float(value[worst, edge])
            error = reached - float(np.clip(reached, *bounds))
            reasons = tuple(_reasons(solver, graph.fps, qpos, worst, first + int(edge), error))
            missed = tuple(frames.tolist())
            unmet = UnmetEdge(track.name, track.edge_name(int(edge)), missed, worst, reached, *bounds, reasons)
            found.append((float(miss[worst, edge]), unmet))
        first += len(track)
    return tuple(unmet for _, unmet in sorted(found, key=lambda each: -each[0]))


def _reasons(solver: FrameSolver, fps: float, qpos: Floats, t: int, edge: int, error: float) -> Iterator[str]:
    """The limits that are active at a frame and oppose the descent of an edge's error."""
    robot, q = solver.robot, qpos[t]
    slope = _slope(solver, q, edge)
    away = -np.sign(error) * slope  # towards the interval
    if np.abs(slope).max(initial=0.0) < STATIONARY:
        yield "no joint brings it closer: the distance is at its extremum"
        return
    angles, reach = qpos[:, robot.qpos_index], solver.speed / fps
    for k in np.argsort(-np.abs(slope)):
        if np.abs(slope[k]) < MATTERS * np.abs(slope).max():
            break
        bound = (solver.ranges.upper if away[k] > 0 else solver.ranges.lower)[k]
        if (bound - angles[t, k]) * np.sign(away[k]) < AT_BOUND:
            yield f"{robot.joint_names[k]} is at its joint range ({np.degrees(bound):.0f}°)"
        elif _at_speed(angles, reach, t, int(k), float(np.sign(away[k]))):
            yield f"{robot.joint_names[k]} is at its speed limit ({solver.speed[k]:.1f} rad/s)"
    yield from _links(solver, q, away)


def _slope(solver: FrameSolver, q: Floats, edge: int) -> Floats:
    """(n,) how an edge's measure changes with the hinges, by central differences."""
    robot, found = solver.robot, np.zeros(len(solver.hinges))
    for k, dof in enumerate(solver.hinges):
        step = np.zeros(robot.model.nv)
        step[dof] = PROBE
        ahead, behind = (solver.problem.values(integrate(robot, q, sign * step))[edge] for sign in (1, -1))
        found[k] = (ahead - behind) / (2 * PROBE)
    return found


def _at_speed(angles: Floats, reach: Floats, t: int, joint: int, sign: float) -> bool:
    """Whether a joint's speed limit to a neighbour frame keeps it from moving further in a direction."""
    neighbours = [angles[k, joint] for k in (t - 1, t + 1) if 0 <= k < len(angles)]
    return any(sign * (angles[t, joint] - other) > (1 - 10 * AT_BOUND) * reach[joint] for other in neighbours)


def _links(solver: FrameSolver, q: Floats, away: Floats) -> Iterator[str]:
    """Pairs of links at their separation margin that a motion of the hinges (n,) brings nearer."""
    apart = solver.costs.separation
    if apart is None:
        return
    distance, geoms, slope = apart.found(q)
    rest = apart.rest[geoms[:, 0], geoms[:, 1]]
    near = (-apart.clearance_deficit(distance, rest) < AT_BOUND) & (slope[:, solver.hinges] @ away < 0)
    model = solver.robot.model
    pairs = {tuple(model.body(int(model.geom_bodyid[g])).name for g in pair) for pair in geoms[near]}
    for a, b in sorted(pairs):
        yield f"{a} and {b} are at their separation"
