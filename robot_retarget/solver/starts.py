"""Starts of descents: the reference pose, the standing pose, poses with drawn limbs."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.graph.describe import RobotGraph
from robot_retarget.robot import Anatomy, Robot
from robot_retarget.robot.anatomy import limb_hinges, mirror_of
from robot_retarget.robot.dynamics import Placer, body_placer
from robot_retarget.solver.descent import FrameSolution
from robot_retarget.solver.limits import Targets
from robot_retarget.solver.options import Search
from robot_retarget.solver.sqp import FrameSolver

LIMBS = ("l_hand", "r_hand", "head")
"""Ends of the limbs that change basins independently."""


def multistart(
    solver: FrameSolver, graph: RobotGraph, all_targets: Targets, frames: Sequence[int], search: Search
) -> list[list[FrameSolution]]:
    """Return per frame the minima that descents from several starts reach, the cheapest first.

    Of several ends in one basin, that of the first start is kept.

    Ends in one basin differ by their tolerance, and so would the choice of the cheapest of them.

    The starts are the reference pose, the standing pose, and standing poses with drawn limbs. Each limb is drawn many
    times within its ranges, and the draws are sorted by cost: the first start has the best draw of each limb, the
    second start the second best, and so on.
    """
    limbs, placed = limb_starts(solver, search), []
    given = (place_root(graph, q, frames) for q in (solver.robot.neutral(), solver.robot.standing()))
    for frame, reference, standing in zip(frames, *given, strict=True):
        drawn = _limbs_drawn(solver, standing, all_targets.at(frame), limbs, search)
        placed.append([reference, standing, *(solver.clear_of_links(standing, q) for q in drawn)])
    rough, exact = 10 * search.tolerance, search.tolerance
    roughly = descended(solver, all_targets, frames, placed, iterations=search.rough, tolerance=rough)
    starts = []
    for frame, ends in zip(frames, roughly, strict=True):
        minima = _minima(solver, ends, search)[: search.finished]
        combined = _limbs_combined(solver, minima, all_targets.at(frame), limbs)
        starts.append([combined, *(end.qpos for end in minima)])
    most = solver.options.iterations
    return [
        _minima(solver, ends, search)
        for ends in descended(solver, all_targets, frames, starts, iterations=most, tolerance=exact)
    ]


def _limbs_combined(
    solver: FrameSolver, ends: Sequence[FrameSolution], targets: Targets, limbs: Iterable[tuple[int, ...]]
) -> Floats:
    """Return the first of some poses with each limb as the one of them has it in which the first costs least."""
    combined = ends[0].qpos.copy()
    for limb in limbs:
        columns = solver.robot.qpos_index[list(limb)]
        poses = np.repeat(ends[0].qpos[None], len(ends), axis=0)
        poses[:, columns] = [end.qpos[columns] for end in ends]
        cost = solver.problem.cost(poses, targets.at(None).at(np.zeros(len(poses), dtype=int)))
        combined[columns] = poses[cost.argmin(), columns]
    return combined


def descended(
    solver: FrameSolver,
    all_targets: Targets,
    frames: Sequence[int],
    starts: Sequence[Sequence[Floats]],
    **options: Any,
) -> list[list[FrameSolution]]:
    """Return where descents end, in the order of their starts at some frames."""
    every = all_targets.at(np.repeat(frames, [len(own) for own in starts]))
    found = iter(solver.solve_frames(np.concatenate(starts), every, **options))
    return [list(islice(found, len(own))) for own in starts]


def _minima(solver: FrameSolver, ends: list[FrameSolution], search: Search) -> list[FrameSolution]:
    """Return one end of every basin, the cheapest first."""
    minima: list[FrameSolution] = []
    for end in ends:
        if not any(same_basin(solver, end, other, search) for other in minima):
            minima.append(end)
    return sorted(minima, key=lambda end: end.cost)


def same_basin(solver: FrameSolver, first: FrameSolution, second: FrameSolution, search: Search) -> bool:
    """Return whether all hinges of two poses differ by no more than the basin threshold `Search.same`."""
    hinges = solver.robot.qpos_index
    return bool(np.abs(first.qpos - second.qpos)[hinges].max(initial=0.0) < search.same)


def _limbs_drawn(
    solver: FrameSolver, base: Floats, targets: Targets, limbs: Mapping[tuple[int, ...], Floats], search: Search
) -> list[Floats]:
    """Return poses with the best draw of each limb, the best that is `Search.apart` from it, and so on."""
    best = [base.copy() for _ in range(search.starts)]
    for limb, angles in limbs.items():
        columns = solver.robot.qpos_index[list(limb)]
        poses = np.repeat(base[None], len(angles), axis=0)
        poses[:, columns] = angles
        cost = solver.problem.cost(poses, targets.at(None).at(np.zeros(len(poses), dtype=int)))
        for start, own in zip(best, _spread(angles[np.argsort(cost, kind="stable")], search.apart), strict=False):
            start[columns] = own
    return best


def _spread(angles: Floats, apart: float) -> Floats:
    """Return draws (N, n) in their order: first those with a hinge further than a distance from every one before [rad]."""
    first: list[int] = []
    for k, own in enumerate(angles):
        if (np.abs(angles[first] - own).max(axis=1, initial=0.0) > apart).all():
            first.append(k)
    return np.concatenate([angles[first], np.delete(angles, first, axis=0)])


def limb_starts(solver: FrameSolver, search: Search) -> dict[tuple[int, ...], Floats]:
    """Return per limb the angles (drawn, n) to try [rad]; the right arm tries the mirror images of the left arm's.

    The name of its end seeds the draws of a limb, and its hinges are drawn along the chain, so that the order in which a
    model lists its bodies does not matter.
    """
    robot, anatomy = solver.robot, solver.problem.match.anatomy
    limbs = {end: limb_hinges(robot, anatomy, end) for end in LIMBS if end in anatomy.sites}
    every = np.zeros((search.drawn, len(robot.lower)))
    for end, limb in limbs.items():
        draws = np.random.default_rng(list(end.encode())).random((search.drawn, len(limb)))
        every[:, limb] = robot.lower[limb] + draws * (robot.upper - robot.lower)[limb]
    mirror = mirror_of(robot, np.cross([0.0, 0.0, 1.0], anatomy.forward))
    other = np.clip(mirror.angles(every), robot.lower, robot.upper)
    chosen = {"l_hand": every, "r_hand": other, "head": (every + other) / 2}
    return {
        tuple(limb.tolist()): (chosen[end] if (mirror.partner[limb] >= 0).all() else every)[:, limb]
        for end, limb in limbs.items()
        if limb.size
    }


def place_root(graph: RobotGraph, qpos: Floats, frames: Iterable[int]) -> list[Floats]:
    """Return a pose at frames: its root is turned and moved so that the pelvis has its target position and heading."""
    placed = root_placer(graph.robot, graph.match.anatomy, qpos)
    return [placed(graph.pelvis[frame], graph.human.facing[frame]) for frame in frames]


def root_placer(robot: Robot, anatomy: Anatomy, qpos: Floats) -> Placer:
    """Return what moves the root of a pose so that the pelvis is at a position (3,) [m] with a rotation (3, 3)."""
    body, axes = anatomy.frames.get("pelvis", (robot.root_body, np.eye(3)))
    site = anatomy.sites.get("pelvis")
    offset = site.offset if site is not None and site.body == body else np.zeros(3)
    placed = body_placer(robot, qpos, body, offset)
    return lambda pelvis, facing: placed(pelvis, facing @ axes.T)
