"""Which links of a robot may touch each other: the pairs worth watching.

By the model's own rules: contact types, excluded bodies, explicit pairs, no link with itself or with its parent. Left
out besides: geoms that overlap where the robot rests (they do so by construction), and links few hinges apart that no
pose within the joint ranges brings together.
"""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot.capsules import collision_geoms
from robot_retarget.robot.model import Robot

FEW_HINGES = 3
"""Links so many hinges apart are tried in poses drawn from the joint ranges."""
POSES = 800
NEVER = 0.005
"""A pair that stays farther apart than this in all those poses is left out [m]."""
FEW_GEOMS = 4
"""Links with more pairs of geoms than this, on the average, have those far apart sorted out by balls first."""


@dataclass(frozen=True)
class Pairs:
    """P pairs of links and, for each, the pairs of geoms that may touch."""

    links: Ints
    """(P, 2) body ids, the lower first."""
    geoms: tuple[tuple[tuple[int, int], ...], ...]
    """P lists of geom pairs."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", frozen(np.reshape(self.links, (-1, 2)), np.int64))

    def __len__(self) -> int:
        return len(self.links)

    def of(self, keep: np.ndarray) -> "Pairs":
        """Those that a mask (P,) chooses."""
        return Pairs(self.links[keep], tuple(self.geoms[k] for k in np.flatnonzero(keep)))

    def names(self, robot: Robot) -> list[tuple[str, str]]:
        """The links' names."""
        return [(robot.model.body(a).name, robot.model.body(b).name) for a, b in self.links.tolist()]


class Clearance:
    """Distances between the geoms of pairs of links, by MuJoCo."""

    def __init__(self, robot: Robot, pairs: Pairs):
        self.model, self.data, self.pairs = robot.model, mujoco.MjData(robot.model), pairs
        self._geoms = [np.array(geoms, dtype=np.int64).T for geoms in pairs.geoms]

    def place(self, qpos: Floats) -> None:
        """Take up a configuration (nq,)."""
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def frames(self) -> tuple[Floats, Floats]:
        """Positions (1, B, 3) [m] and rotations (1, B, 3, 3) of the bodies as placed."""
        return self.data.xpos[None], self.data.xmat.reshape(1, -1, 3, 3)

    def of(self, pair: int, reach: float) -> float:
        """Distance of a pair as placed [m], negative inside, `reach` for all that is farther."""
        model, data, least = self.model, self.data, reach
        for a, b in self.pairs.geoms[pair]:
            least = min(least, mujoco.mj_geomDistance(model, data, a, b, least, None))
        return least

    def along(self, path: Floats, pairs: Ints, reach: Floats) -> Floats:
        """Distances (K, N) of some pairs (N,) at configurations (K, nq) [m], `reach` (N,) for all that is farther."""
        found = np.tile(reach, (len(path), 1))
        if not len(pairs):
            return found
        tables = [self._geoms[pair] for pair in pairs.tolist()]
        owner = np.repeat(np.arange(len(pairs)), [table.shape[1] for table in tables])
        geoms = np.concatenate(tables, axis=1)
        few = len(owner) <= FEW_GEOMS * len(pairs)
        bounds = np.full((len(path), len(owner)), -np.inf) if few else self._bounds(path, geoms)
        listed = list(zip(owner.tolist(), *geoms.tolist(), strict=True))
        model, data = self.model, self.data
        for qpos, row, bound in zip(path, found, bounds, strict=True):
            self.place(qpos)
            least, order = row.tolist(), range(len(listed)) if few else np.argsort(bound).tolist()
            for k, apart in zip(order, (bound if few else bound[order]).tolist(), strict=True):
                pair, a, b = listed[k]
                if apart < least[pair]:
                    least[pair] = min(least[pair], mujoco.mj_geomDistance(model, data, a, b, least[pair], None))
            row[:] = least
        return found

    def _bounds(self, path: Floats, geoms: Ints) -> Floats:
        """(K, G) how far apart the balls around two geoms (2, G) are [m]: less than the geoms."""
        centres = np.empty((len(path), self.model.ngeom, 3))
        for k, qpos in enumerate(path):
            self.place(qpos)
            centres[k] = self.data.geom_xpos
        gap = centres[:, geoms[0]] - centres[:, geoms[1]]
        return np.sqrt(np.einsum("kga,kga->kg", gap, gap)) - self.model.geom_rbound[geoms].sum(axis=0)

    def all(self, qpos: Floats, reach: float) -> Floats:
        """Distances (P,) at a configuration (nq,) [m]."""
        self.place(qpos)
        return np.array([self.of(pair, reach) for pair in range(len(self.pairs))])


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
    clearance.place(qpos)
    flat = [(links, pair) for links, pairs in table.items() for pair in pairs]
    kept: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k, (links, pair) in enumerate(flat):
        if clearance.of(k, NEVER) >= 0:
            kept.setdefault(links, []).append(pair)
    return kept


def _ever_near(robot: Robot, pairs: Pairs) -> np.ndarray:
    """(P,) whether links come near each other in any of many poses; those many hinges or a slide apart are taken to."""
    hinges = set(robot.joint_ids.tolist())
    between = [_joints_between(robot, a, b) for a, b in pairs.links.tolist()]
    near = np.array([len(joints) > FEW_HINGES or not joints <= hinges for joints in between], dtype=bool)
    clearance, draw = Clearance(robot, pairs), np.random.default_rng(0)
    qpos = robot.neutral()
    for _ in range(POSES):
        # Joints stand at the ends of their ranges as often as not: that is where links meet.
        share = np.clip(draw.uniform(-0.5, 1.5, len(robot.lower)), 0, 1)
        qpos[robot.qpos_index] = robot.lower + share * (robot.upper - robot.lower)
        clearance.place(qpos)
        for pair in np.flatnonzero(~near):
            near[pair] = clearance.of(int(pair), 2 * NEVER) < NEVER
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
