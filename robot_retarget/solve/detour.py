"""A way around, where links stand between a pose and another one: hands that rest behind the hips are to come before them."""

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.solve.frame import FrameSolver
from robot_retarget.solve.starts import drawn_limbs

PLACES = 8
"""A straight way is looked at in so many places."""
CLOSED = 1e-3
"""Chains are closed, and ranges kept, within this [m or rad]."""
MOVED = 0.1
"""A limb goes around when one of its hinges has farther to go [rad]."""


def detour(solver: FrameSolver, start: Floats, end: Floats) -> Floats | None:
    """A configuration to pass on the way from `start` to `end` (nq,): of those with drawn limbs the one that makes the
    shortest way without links inside each other; none where the straight way is clear, or where none is found.
    """
    if clear(solver, start, end):
        return None
    stops = _stops(solver, start, end)
    hinges = solver.robot.qpos_index
    far = [np.abs(via - start)[hinges].max() + np.abs(end - via)[hinges].max() for via in stops]
    ways = (stops[k] for k in np.argsort(far))
    return next((via for via in ways if clear(solver, start, via) and clear(solver, via, end)), None)


def clear(solver: FrameSolver, start: Floats, end: Floats) -> bool:
    """Whether no links are inside each other while all hinges go straight from one configuration to another."""
    hinges, q = solver.robot.qpos_index, start.copy()
    for share in np.linspace(0, 1, PLACES + 2)[1:-1]:
        q[hinges] = start[hinges] + share * (end - start)[hinges]
        if solver.overlapping(q):
            return False
    return True


def _stops(solver: FrameSolver, start: Floats, end: Floats) -> list[Floats]:
    """Configurations halfway, with the limbs that are to move as they are drawn: left and right in mirrored pairs."""
    robot = solver.robot
    tables = drawn_limbs(solver)
    apart = np.abs(end - start)[robot.qpos_index]
    moved = {limb: table for limb, table in tables.items() if apart[list(limb)].max() > MOVED}
    stops = []
    for row in range(solver.options.drawn if moved else 0):
        via = start.copy()
        via[robot.qpos_index] = (start + end)[robot.qpos_index] / 2
        for limb, table in moved.items():
            via[robot.qpos_index[list(limb)]] = table[row]
        stops.append(solver.landscape.coupling.closed(via))
    return [via for via in stops if _within(solver, via)]


def _within(solver: FrameSolver, qpos: Floats) -> bool:
    """Whether closing its chains has left a configuration within the ranges, and closed them."""
    coupling = solver.landscape.coupling
    closed = not coupling.present or np.abs(coupling(qpos)[0]).max() < CLOSED
    return bool(closed) and solver.ranges.outside(qpos[solver.robot.qpos_index]) < CLOSED
