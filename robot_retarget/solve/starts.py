"""Where to start when no frame before tells: standing poses with limbs that were drawn and cost little."""

from dataclasses import replace

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges
from robot_retarget.robot import Robot
from robot_retarget.robot.anatomy import limb_hinges
from robot_retarget.robot.mirror import Mirror
from robot_retarget.robot.root import put
from robot_retarget.solve.frame import FrameSolver, Pose
from robot_retarget.solve.problem import Problem, frame_parameters

ROUGHLY = 1e-2
"""As `Options.tolerance`: the ways are told apart long before they are exact."""
AT_BOUND = 0.01
"""A hinge this near to its bound stands at it [rad]."""
OWN = 4
"""So many times as many starts for a robot's own motion: only one way meets it, and some others nearly do."""
UNLIKE = 1.0
"""Draws of a limb are unlike each other when a hinge differs by more [rad]."""


def ways(
    solver: FrameSolver, wished: tuple[Floats, ...], edges: Edges, frame: int, alike: float = ROUGHLY
) -> list[Pose]:
    """Where descents from several starts end, the cheapest first; ends that cost nearly the same in their order.

    The starts are the reference pose, the standing pose, and standing poses whose limbs are each as they cost
    little among many drawn within their ranges: the best of each limb together, the second best, and so on.

    Args:
        alike: ends cost nearly the same that cost no more than so much of the least on top of it [-].
    """
    robot, problem = solver.robot, solver.problem
    placed = [
        place_root(problem, q, edges.root[frame], edges.facing[frame]) for q in (robot.neutral(), robot.standing())
    ]
    placed += _limbs_drawn(solver, placed[1], wished)
    ends = [_descended(solver, q, wished, 2 * solver.options.iterations) for q in placed]
    least = min(end.cost for end in ends)
    return sorted(ends, key=lambda end: max(end.cost, (1 + alike) * least))


def lying(solver: FrameSolver, edges: Edges, held: np.ndarray, frame: int) -> tuple[Floats, ...]:
    """What is asked of a frame for which no footholds are known yet: standing soles `held` (T, F, 4) lie on the floor."""
    return (*frame_parameters(edges, frame), *solver.grip.lay_down(held[frame]))


def _descended(solver: FrameSolver, start: Floats, wished: tuple[Floats, ...], iterations: int) -> Pose:
    """Where a rough descent ends, and what it costs there: closing its chains may have moved it much.

    Where it is stopped by the bound of a hinge that turns in full, a robot's own motion may go on from the other. (With a
    human's, which is met exactly on neither side, that would only give more ways, some of them rougher.)
    """
    end = solver.descend(start, wished, iterations=iterations, tolerance=ROUGHLY)
    if solver.problem.match.itself and ((beyond := _turned_on(solver.robot, end.qpos)) != end.qpos).any():
        other = solver.descend(beyond, wished, iterations=iterations, tolerance=ROUGHLY)
        end = min(end, other, key=lambda pose: pose.cost)
    return replace(end, cost=solver.landscape.around(end.qpos, wished).cost)


def _turned_on(robot: Robot, qpos: Floats) -> Floats:
    """The same configuration, with hinges that turn in full put from the bound at which they stand to the other."""
    lower, upper, angles = robot.lower, robot.upper, qpos[robot.qpos_index]
    sense = 1 * (angles < lower + AT_BOUND) - 1 * (angles > upper - AT_BOUND)
    full = upper - lower > 2 * np.pi - AT_BOUND
    turned = qpos.copy()
    turned[robot.qpos_index] = np.clip(angles + 2 * np.pi * sense * full, lower, upper)
    return turned


def _limbs_drawn(solver: FrameSolver, base: Floats, wished: tuple[Floats, ...]) -> list[Floats]:
    count = solver.options.starts * (OWN if solver.problem.match.itself else 1)
    best = [base.copy() for _ in range(count)]
    for limb, angles in drawn_limbs(solver).items():
        columns = solver.robot.qpos_index[list(limb)]
        poses = np.repeat(base[None], len(angles), axis=0)
        poses[:, columns] = angles
        cost = [float(solver.problem.cost(pose, *wished)[0][0]) for pose in poses]
        for start, k in zip(best, np.argsort(cost), strict=False):
            start[columns] = angles[k]
    return best


def unlike(costs: Floats, angles: Floats, most: int) -> list[int]:
    """Rows of the cheapest of some draws (N, n), each unlike those before it; at most so many."""
    chosen: list[int] = []
    for row in np.argsort(costs, kind="stable").tolist():
        if len(chosen) < most and (np.abs(angles[chosen] - angles[row]).max(axis=1) > UNLIKE).all():
            chosen.append(row)
    return chosen


def drawn_limbs(solver: FrameSolver) -> dict[tuple[int, ...], Floats]:
    """Per limb the angles (drawn, n) to try [rad]; what one side tries, the other tries mirrored."""
    robot, anatomy = solver.robot, solver.problem.match.anatomy
    draw, sides = np.random.default_rng(solver.options.seed), solver.symmetry.mirror
    every = draw.uniform(robot.lower, robot.upper, (solver.options.drawn, len(robot.lower)))
    other = np.clip(sides.angles(every), robot.lower, robot.upper)
    straight = (every + other) / 2  # a motion that is its own mirror image should not begin with a side
    chosen = {"l_hand": every, "r_hand": other, "head": straight}
    limbs = {end: tuple(limb_hinges(robot, anatomy, end).tolist()) for end in chosen if end in anatomy.spots}
    paired = {limb: chosen[end] for end, limb in limbs.items() if limb}
    return {limb: (table if _mirrored(sides, limb) else every)[:, list(limb)] for limb, table in paired.items()}


def _mirrored(sides: Mirror, limb: tuple[int, ...]) -> bool:
    return bool((sides.partner[list(limb)] >= 0).all())


def place_root(problem: Problem, qpos: Floats, pelvis: Floats, facing: Floats) -> Floats:
    """A pose with its root turned and moved so that the pelvis has the wished frame (3, 3) and place (3,) [m]."""
    robot, anatomy = problem.robot, problem.match.anatomy
    body, axes = anatomy.frames.get("pelvis", (robot.root_body, np.eye(3)))
    spot = anatomy.spots.get("pelvis")
    offset = spot.offset if spot is not None and spot.body == body else np.zeros(3)
    return put(robot, qpos, body, offset, pelvis, facing @ axes.T)
