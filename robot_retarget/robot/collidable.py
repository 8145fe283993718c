"""Which links of a robot may touch each other: the pairs worth watching.

By the model's own rules: contact types, excluded bodies, explicit pairs, no link with itself or with its parent. Left
out besides: geoms that overlap where the robot rests (they do so by construction), and links few hinges apart that no
pose within the joint ranges brings together.
"""

import itertools

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.capsules import collision_geoms
from robot_retarget.robot.clearance import Clearance, Pairs
from robot_retarget.robot.model import Robot

FEW_HINGES = 3
"""Links so many hinges apart are tried in poses drawn from the joint ranges."""
POSES = 800
NEVER = 0.005
"""A pair that stays farther apart than this in all those poses is left out [m]."""


def collidable(robot: Robot) -> Pairs:
    """Pairs of links that may touch."""
    table = allowed(robot)
    for rest in (robot.neutral(), np.array(robot.model.qpos0)):
        table = _apart(robot, table, rest)
    links = sorted(table)
    pairs = Pairs(np.array(links, dtype=int), tuple(tuple(table[pair]) for pair in links))
    return pairs.of(_ever_near(robot, pairs))


def allowed(robot: Robot) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Geom pairs (a < b) by link pair, as the model's contact filter lets them through."""
    model = robot.model
    link = np.asarray(model.body_weldid)
    carrier = link[model.body_parentid[link]]
    shut = {tuple(sorted((int(code) >> 16, int(code) & 0xFFFF))) for code in model.exclude_signature}
    explicit = {tuple(sorted(map(int, pair))) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    solid = [g for geoms in collision_geoms(robot).values() for g in geoms]
    listed = explicit | set(itertools.combinations(sorted(solid), 2))
    table: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for a, b in sorted(listed):
        bodies = int(model.geom_bodyid[a]), int(model.geom_bodyid[b])
        first, second = sorted(int(link[body]) for body in bodies)
        related = carrier[first] == second or carrier[second] == first
        types = (model.geom_contype[a] & model.geom_conaffinity[b]) | (
            model.geom_contype[b] & model.geom_conaffinity[a]
        )
        let_through = types and not related and tuple(sorted(bodies)) not in shut
        if first != second and first > 0 and (let_through or (a, b) in explicit):
            table.setdefault((first, second), []).append((a, b))
    return table


def _apart(
    robot: Robot, table: dict[tuple[int, int], list[tuple[int, int]]], qpos: Floats
) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """The geom pairs that do not overlap at a configuration."""
    clearance = Clearance(
        robot, Pairs(np.zeros((0, 2), dtype=np.int64), tuple((pair,) for pairs in table.values() for pair in pairs))
    )
    flat = [(links, pair) for links, pairs in table.items() for pair in pairs]
    apart = clearance.along(qpos[None], np.arange(len(flat)), np.full(len(flat), NEVER))[0] >= 0
    kept: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for links, pair in itertools.compress(flat, apart):
        kept.setdefault(links, []).append(pair)
    return kept


def _ever_near(robot: Robot, pairs: Pairs) -> np.ndarray:
    """(P,) whether links come near each other in any of many poses; those many hinges or a slide apart are taken to."""
    hinges = set(robot.joint_ids.tolist())
    between = [_joints_between(robot, a, b) for a, b in pairs.links.tolist()]
    near = np.array([len(joints) > FEW_HINGES or not joints <= hinges for joints in between], dtype=bool)
    # Joints stand at the ends of their ranges as often as not: that is where links meet.
    share = np.clip(np.random.default_rng(0).uniform(-0.5, 1.5, (POSES, len(robot.lower))), 0, 1)
    poses = np.tile(robot.neutral(), (POSES, 1))
    poses[:, robot.qpos_index] = robot.lower + share * (robot.upper - robot.lower)
    few = np.flatnonzero(~near)
    near[few] = (Clearance(robot, pairs).along(poses, few, np.full(len(few), NEVER)) < NEVER).any(axis=0)
    return near


def _joints_between(robot: Robot, first: int, second: int) -> set[int]:
    """Joints that move one link against another."""
    model = robot.model

    def way(body: int) -> set[int]:
        line = [body]
        while line[-1]:
            line.append(int(model.body_parentid[line[-1]]))
        return set(line)

    apart = way(first) ^ way(second)
    return {joint for joint in range(model.njnt) if model.jnt_bodyid[joint] in apart}
