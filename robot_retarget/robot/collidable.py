"""Which links of a robot may touch each other: the pairs worth watching.

By the model's own rules: contact types, excluded bodies, explicit pairs, no link with itself or with its parent. Left
out besides: geoms that overlap where the robot rests (they do so by construction), and those of links few hinges apart
that no pose within the joint ranges brings together.
"""

import itertools

import numpy as np

from robot_retarget.arrays import Floats
from robot_retarget.robot.capsules import collision_geoms, shapes_stand_in
from robot_retarget.robot.clearance import Clearance, Pairs
from robot_retarget.robot.model import Robot

Table = dict[tuple[int, int], list[tuple[int, int]]]
"""Pairs of geoms by pair of links."""
FEW_HINGES = 3
"""Geoms of links so many hinges apart are tried in poses drawn from the joint ranges."""
POSES = 800
NEVER = 0.005
"""A pair that stays farther apart than this in all those poses is left out [m]."""


def collidable(robot: Robot) -> Pairs:
    """Pairs of links that may touch."""
    table = allowed(robot)
    for rest in (robot.neutral(), np.array(robot.model.qpos0)):
        table = _apart(robot, table, rest)
    table = _ever_near(robot, table)
    links = sorted(table)
    return Pairs(np.array(links, dtype=int), tuple(tuple(table[pair]) for pair in links))


def allowed(robot: Robot) -> Table:
    """Geom pairs (a < b) by link pair, as the model's contact filter lets them through."""
    model = robot.model
    link = np.asarray(model.body_weldid)
    carrier = link[model.body_parentid[link]]
    shut = {tuple(sorted((int(code) >> 16, int(code) & 0xFFFF))) for code in model.exclude_signature}
    explicit = {tuple(sorted(map(int, pair))) for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    solid = [g for geoms in collision_geoms(robot).values() for g in geoms]
    stand_in = shapes_stand_in(robot)
    listed = explicit | set(itertools.combinations(sorted(solid), 2))
    table: Table = {}
    for a, b in sorted(listed):
        bodies = int(model.geom_bodyid[a]), int(model.geom_bodyid[b])
        first, second = sorted(int(link[body]) for body in bodies)
        related = carrier[first] == second or carrier[second] == first
        types = (model.geom_contype[a] & model.geom_conaffinity[b]) | (
            model.geom_contype[b] & model.geom_conaffinity[a]
        )
        let_through = (types or stand_in) and not related and tuple(sorted(bodies)) not in shut
        if first != second and first > 0 and (let_through or (a, b) in explicit):
            table.setdefault((first, second), []).append((a, b))
    return table


def _apart(robot: Robot, table: Table, qpos: Floats) -> Table:
    """The geom pairs that do not overlap at a configuration."""
    return _chosen(table, (_distances(robot, table, qpos[None]) >= 0)[0])


def _ever_near(robot: Robot, table: Table) -> Table:
    """The geom pairs that come near each other in any of many poses; those many hinges or a slide apart are taken to."""
    hinges = set(robot.joint_ids.tolist())
    between = {links: _joints_between(robot, *links) for links in table}
    few = {links: table[links] for links, joints in between.items() if len(joints) <= FEW_HINGES and joints <= hinges}
    # Joints stand at the ends of their ranges as often as not: that is where links meet.
    share = np.clip(np.random.default_rng(0).uniform(-0.5, 1.5, (POSES, len(robot.lower))), 0, 1)
    poses = np.tile(robot.neutral(), (POSES, 1))
    poses[:, robot.qpos_index] = robot.lower + share * (robot.upper - robot.lower)
    near = _chosen(few, _distances(robot, few, poses).min(axis=0, initial=NEVER) < NEVER)
    return {links: pairs for links, pairs in table.items() if links not in few} | near


def _distances(robot: Robot, table: Table, path: Floats) -> Floats:
    """(K, G) of all pairs of geoms one by one, `NEVER` for all that is farther [m]."""
    alone = [(links, (pair,)) for links, pairs in table.items() for pair in pairs]
    pairs = Pairs(np.array([links for links, _ in alone], dtype=int), tuple(pair for _, pair in alone))
    return Clearance(robot, pairs).all(path, NEVER)


def _chosen(table: Table, keep: np.ndarray) -> Table:
    """The pairs of geoms that a mask (G,) chooses."""
    kept: Table = {}
    flat = [(links, pair) for links, pairs in table.items() for pair in pairs]
    for links, pair in itertools.compress(flat, keep):
        kept.setdefault(links, []).append(pair)
    return kept


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
