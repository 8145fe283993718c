"""A coarse path through the right minima, before the fine one is solved.

An arm of three joints can follow a human arm in more ways than one, and a solver that goes frame by frame stays in the
way it began. Here several ways are sought at moments spread over the clip, each is followed forward and backward at a
low frame rate until it meets another, and the cheapest path through all of them is chosen by dynamic programming. Where
that leaps, ways across at the joints' speed are put beside the others, and the path is chosen anew: a leap then costs dear.
What it then passes by for want of a way there, it comes nearer to by exchanging single limbs.
Frames that then cost next to nothing, as of a robot's own motion, are sought once more each (`settled`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from robot_retarget.arrays import Floats
from robot_retarget.describe.edges import Edges
from robot_retarget.robot import Robot
from robot_retarget.robot.model import HINGE
from robot_retarget.solve.frame import FrameSolver
from robot_retarget.solve.pool import Pool, Sketching
from robot_retarget.solve.starts import lying

LITTLE = 1.0
"""Frames whose wishes cost less in a sketch are sought once more [-]; those of another body cost more."""


@dataclass(frozen=True, eq=False)
class Draft:
    """What a sketch found."""

    qpos: list[Floats]
    """A configuration (nq,) for every frame."""
    cost: Floats
    """(T,) what each frame's wishes cost there; between those that were sought, straight on."""


def sketch(
    solver: FrameSolver,
    edges: Edges,
    held: np.ndarray,
    fps: float,
    sketching: Sketching | None = None,
    known: list[Floats] | None = None,
) -> Draft:
    """The cheapest path through the ways that were found, carried to every frame of the clip.

    Standing soles `held` (T, F, 4) lie on the floor; where they do is left open. The first frames are `known` already,
    and the path sets out from the last of them.
    """
    chosen, first = sketching or Sketching(), known or []
    step, start = max(1, round(fps / chosen.rate)), max(len(first) - 1, 0)
    beats = np.arange(0, len(edges), step)  # whatever is known: another window sketches the same frames
    frames = np.unique([start, *beats[beats > start], len(edges) - 1])
    pool = Pool(solver, edges, held, frames, fps, chosen)
    stride = max(1, round(chosen.every * fps / step))
    if first:
        pool.set_out(first[-1])
    for moment in range(stride if first else 0, len(frames), stride):
        pool.seek(moment)
    for moment in pool.dearest(pool.cheapest(chosen.hurry), stride):
        pool.seek(moment)
    pool.cross(pool.cheapest(hurry=0.0))
    for _ in range(chosen.mixes):
        if not pool.mix(pool.cheapest(chosen.hurry), stride):
            break
        pool.cross(pool.cheapest(hurry=0.0))
    path, found = pool.cheapest(chosen.hurry), slice(pool.first, None)
    before = first[max(start - 2, 0) : start]
    later = between(solver.robot, frames - start, [pose.qpos for pose in path], before)
    cost = np.interp(np.arange(len(edges)), frames[found], [pose.cost for pose in path[found]])
    return Draft([*first[:start], *later], cost)


def settled(solver: FrameSolver, edges: Edges, held: np.ndarray, draft: Draft, fixed: int = 0) -> Draft:
    """The draft, but frames whose wishes cost little there led to their ends: from where they are, from the one before, or
    from where wishes alone lead.

    Of a robot's own motion a sketch is too rough: sought every tenth of a second only, and not to the end.
    On the wrong side of an edge of a link a frame costs ten times what it must, and what it does is taken for noise.
    """
    qpos, cost = list(draft.qpos), draft.cost.copy()
    for t in [t for t in range(fixed, len(edges)) if cost[t] < LITTLE]:
        wished = lying(solver, edges, held, t)
        starts = qpos[t], qpos[max(t - 1, 0)], solver.unhindered.descend(qpos[t], wished, learning=True).qpos
        pose = min((solver.descend(q, wished, learning=True) for q in starts), key=lambda pose: pose.cost)
        qpos[t], cost[t] = pose.qpos, pose.cost
    return Draft(qpos, cost)


def between(robot: Robot, frames: np.ndarray, poses: list[Floats], before: list[Floats]) -> list[Floats]:
    """Configurations at every frame, on cubic splines through some: straight lines of a tenth of a second would cut a swing
    of half a radian, once a second, short by 0.025 rad.

    Args:
        frames: from 0 on, of the `poses`; those `before` are at frames −1, −2, … and the splines go on from there.
    """
    known, wanted = np.array([*before, *poses]), np.arange(frames[-1] + 1)
    if len(known) == 1:
        return [known[0]]
    knots = np.concatenate([np.arange(-len(before), 0), frames])
    turning = [int(robot.model.jnt_qposadr[j]) for j in robot.root_joints if robot.model.jnt_type[j] == HINGE]
    known[:, turning] = np.unwrap(known[:, turning], axis=0)
    full, hinges = CubicSpline(knots, known)(wanted), robot.qpos_index
    full[:, hinges] = full[:, hinges].clip(robot.lower, robot.upper)
    if robot.floating:
        a = robot.root_address + 3
        turns = RotationSpline(knots, Rotation.from_quat(known[:, a : a + 4], scalar_first=True))
        full[:, a : a + 4] = turns(wanted).as_quat(scalar_first=True)
    return list(full)
