"""Capsules around the collision geoms of every link: shapes whose distance has a closed form.

A capsule is a segment with a radius. Around points x it is found for each of several axes: the radius r is that of the
circle around the points seen along the axis, and the segment reaches as far as the points ask for,

    z₁ = max(z − √(r² − ρ²)),    z₀ = min(z + √(r² − ρ²)),

with z along the axis and ρ across it. The axis whose capsule has the least volume is kept. A link with several geoms
gets several capsules where that takes up much less room.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.arrays import Floats, Ints, frozen
from robot_retarget.robot.kinematics import Points
from robot_retarget.robot.model import Robot

_GEOM = mujoco.mjtGeom
MOST = 2
"""So many capsules a link has at most."""
WORTH = 0.7
"""Two capsules replace one where they take up at most this share of its room."""
TIGHTENING = 40
"""Steps by which a circle is tightened."""
BEST = 4
"""So many axes have their circles tightened."""
_RIM = 32
"""Corners of the polygon around a round face."""
_DIRECTIONS = 256
_CORNERS = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
_SLACK = 1e-7
"""Added to every radius [m], far above rounding."""


@dataclass(frozen=True)
class Capsules:
    """C capsules fixed to links; the links in ascending order."""

    links: Ints
    """(C,) body ids; a link is a body with all that is welded to it."""
    ends: Floats
    """(C, 2, 3) ends of the segments in the link's body frame [m]."""
    radius: Floats
    """(C,) [m]."""
    excess: dict[int, float]
    """Fit error by link [m]: how far the capsules reach beyond the geoms, in the worst direction."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", frozen(self.links, np.int64))
        object.__setattr__(self, "ends", frozen(self.ends))
        object.__setattr__(self, "radius", frozen(self.radius))

    def __len__(self) -> int:
        return len(self.links)

    @cached_property
    def by_link(self) -> dict[int, list[int]]:
        """The capsules of each link."""
        return {int(link): np.flatnonzero(self.links == link).tolist() for link in np.unique(self.links)}

    @property
    def points(self) -> Points:
        """Both ends of one capsule after the other."""
        return Points(np.repeat(self.links, 2), self.ends)


def collision_geoms(robot: Robot) -> dict[int, list[int]]:
    """Geoms that take part in contacts, by type or as one of an explicit pair, by link; the world has no part in it.

    Of a model that lets no two links touch, all that is seen (`shapes_stand_in`).
    """
    model = robot.model
    touching = (model.geom_contype | model.geom_conaffinity) != 0
    touching[[*model.pair_geom1, *model.pair_geom2]] = True
    return _by_link(model, touching | shapes_stand_in(robot))


def solid_geoms(robot: Robot) -> dict[int, list[int]]:
    """Geoms that are solid to the eye, by link: those that take part in contacts, all of a link that has none of these."""
    return _by_link(robot.model, np.ones(robot.model.ngeom, dtype=bool)) | collision_geoms(robot)


def shapes_stand_in(robot: Robot) -> bool:
    """Whether what is seen of links stands in for collision shapes: the model has none by type, and no pair of links."""
    model = robot.model
    link = np.asarray(model.body_weldid)[model.geom_bodyid]
    by_type = ((model.geom_contype | model.geom_conaffinity) != 0) & (link > 0)
    first, second = link[model.pair_geom1], link[model.pair_geom2]
    return not (by_type.any() or ((first > 0) & (second > 0)).any())


def touchable(robot: Robot) -> mujoco.MjModel:
    """The robot's model, in a copy where shapes stand in for collision shapes."""
    if not shapes_stand_in(robot):
        return robot.model
    model = copy.deepcopy(robot.model)
    own = np.asarray(model.body_weldid)[model.geom_bodyid] > 0
    model.geom_contype[own] = model.geom_conaffinity[own] = 1
    model.body_contype[:] = model.body_conaffinity[:] = (
        np.asarray(model.body_weldid) > 0
    )  # the broad phase goes by bodies
    return model


def _by_link(model: mujoco.MjModel, chosen: np.ndarray) -> dict[int, list[int]]:
    link, found = np.asarray(model.body_weldid)[model.geom_bodyid], {}
    for geom in np.flatnonzero(chosen & (link > 0)):
        found.setdefault(int(link[geom]), []).append(int(geom))
    return dict(sorted(found.items()))


def fit_capsules(robot: Robot) -> Capsules:
    """Capsules around the collision geoms of every link, and how far they reach beyond them."""
    links, ends, radii, excess = [], [], [], {}
    for link, clouds in link_clouds(robot).items():
        found = _cover(clouds)
        links += [link] * len(found)
        ends += [capsule.ends for capsule in found]
        radii += [capsule.radius for capsule in found]
        excess[link] = _excess(found, clouds)
    return Capsules(np.array(links, int), np.reshape(ends, (-1, 2, 3)), np.array(radii), excess)


def link_clouds(robot: Robot) -> dict[int, list["Cloud"]]:
    """Of every link that takes part in contacts, a cloud for each of its geoms, in the frame of the link's body."""
    data = mujoco.MjData(robot.model)
    mujoco.mj_kinematics(robot.model, data)
    links = collision_geoms(robot).items()
    return {link: [_in_link(robot.model, data, geom, link) for geom in geoms] for link, geoms in links}


@dataclass(frozen=True)
class Cloud:
    """A ball of this radius around every point: the hull of all contains a geom and is little larger [m]."""

    points: Floats
    radius: float = 0.0

    @property
    def corners(self) -> Floats:
        """Points whose hull contains the balls. (N, 3)"""
        if not self.radius:
            return self.points
        return (self.points[:, None] + self.radius * _CORNERS).reshape(-1, 3)


@dataclass(frozen=True)
class _Capsule:
    ends: Floats
    radius: float

    @property
    def volume(self) -> float:
        length = float(np.linalg.norm(self.ends[1] - self.ends[0]))
        return float(np.pi * self.radius**2 * (length + 4 / 3 * self.radius))


def _in_link(model: mujoco.MjModel, data: mujoco.MjData, geom: int, link: int) -> Cloud:
    """A geom's cloud in the frame of the link's body."""
    cloud = _cloud(model, geom)
    world = cloud.points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    return Cloud((world - data.xpos[link]) @ data.xmat[link].reshape(3, 3), cloud.radius)


def _cloud(model: mujoco.MjModel, geom: int) -> Cloud:
    """Balls whose hull contains a geom, in the geom's frame; meshes collide as the hull of their vertices."""
    kind, size = model.geom_type[geom], np.array(model.geom_size[geom])
    if kind == _GEOM.mjGEOM_MESH:
        first = model.mesh_vertadr[model.geom_dataid[geom]]
        return Cloud(np.array(model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[geom]]], float))
    if kind == _GEOM.mjGEOM_SPHERE:
        return Cloud(np.zeros((1, 3)), float(size[0]))
    if kind == _GEOM.mjGEOM_CAPSULE:
        return Cloud(np.array([[0, 0, -size[1]], [0, 0, size[1]]]), float(size[0]))
    if kind == _GEOM.mjGEOM_CYLINDER:
        angle = np.arange(_RIM) * 2 * np.pi / _RIM
        across = size[0] / np.cos(np.pi / _RIM)
        rim = np.stack([across * np.cos(angle), across * np.sin(angle), np.full(_RIM, size[1])], 1)
        return Cloud(np.concatenate([rim, rim * [1, 1, -1]]))
    if kind == _GEOM.mjGEOM_ELLIPSOID:  # inside a capsule along its longest axis, as wide as the second
        longest, second = np.argsort(size)[::-1][:2]
        tip = np.eye(3)[longest] * (size[longest] - size[second])
        return Cloud(np.stack([tip, -tip]), float(size[second]))
    middle, half = model.geom_aabb[geom].reshape(2, 3)
    return Cloud(middle + _CORNERS * half)


def _cover(clouds: list[Cloud], most: int = MOST) -> list[_Capsule]:
    """One capsule around all clouds, or several around parts of them."""
    whole = _around(clouds)
    if len(clouds) < 2 or most < 2:
        return [whole]
    parts = min((_halves(clouds, axis) for axis in np.eye(3)), key=_room)
    if _room(parts) > WORTH * _room((clouds,)):
        return [whole]
    return [capsule for part in parts for capsule in _cover(part, most // 2)]


def _halves(clouds: list[Cloud], axis: Floats) -> tuple[list[Cloud], ...]:
    """The clouds in two groups along an axis, parted where the two capsules are smallest."""
    order = np.argsort([(cloud.points @ axis).mean() for cloud in clouds])
    ways = [([clouds[k] for k in order[:cut]], [clouds[k] for k in order[cut:]]) for cut in range(1, len(clouds))]
    return min(ways, key=_room)


def _room(parts: Sequence[list[Cloud]]) -> float:
    """What capsules along coordinate axes around the parts would fill [m³]."""
    return sum(min(_along(*_stacked(part), axis, 0).volume for axis in np.eye(3)) for part in parts)


def _stacked(clouds: list[Cloud]) -> tuple[Floats, Floats]:
    """Points (N, 3) and radii (N,) of several clouds."""
    radii = [np.full(len(cloud.points), cloud.radius) for cloud in clouds]
    return np.concatenate([cloud.points for cloud in clouds]), np.concatenate(radii)


def _around(clouds: list[Cloud]) -> _Capsule:
    """The smallest capsule found around clouds: the best axes of a choice, with their circles tightened."""
    points, radii = _stacked(clouds)
    main = np.linalg.svd(points - points.mean(0), full_matrices=True)[2]
    axes = np.concatenate([np.eye(3), main, _turned(main)])
    rough = np.argsort([_along(points, radii, axis, 0).volume for axis in axes])
    found = [_along(points, radii, axis, TIGHTENING) for axis in axes[rough[:BEST]]]
    best = min(found, key=lambda capsule: capsule.volume)
    return _Capsule(best.ends, best.radius + _SLACK)


def _turned(main: Floats) -> Floats:
    """The main axes turned a little about each other."""
    turns = Rotation.from_rotvec([a * np.eye(3)[k] for k in range(3) for a in (-0.15, 0.15)])
    return np.concatenate([turn.as_matrix() @ main for turn in turns])


def _along(points: Floats, radii: Floats, axis: Floats, rounds: int) -> _Capsule:
    """The capsule along an axis: balls of radius r_i lie in one of radius r where their centres lie in one of r − r_i."""
    across = np.linalg.svd(axis[None])[2][1:]
    flat, z = points @ across.T, points @ axis
    centre = _circle_centre(flat, radii, rounds)
    rho = np.linalg.norm(flat - centre, axis=1)
    radius = float((rho + radii).max())
    room = np.sqrt(np.maximum((radius - radii) ** 2 - rho**2, 0.0))
    low, high = (z + room).min(), (z - room).max()
    ends = np.array([low, high]) if low < high else np.full(2, (low + high) / 2)
    return _Capsule(centre @ across + ends[:, None] * axis, radius)


def _circle_centre(flat: Floats, radii: Floats, rounds: int) -> Floats:
    """Near the centre of the smallest circle around discs: the middle, moved towards the farthest by steps 1/k."""
    middle = (flat.min(0) + flat.max(0)) / 2
    best, least, centre = middle, np.inf, middle
    for k in range(1, rounds + 2):
        away = np.linalg.norm(flat - centre, axis=1) + radii
        far = away.argmax()
        if away[far] < least:
            best, least = centre, away[far]
        centre = centre + (flat[far] - centre) / (k + 1)
    return best


def _excess(capsules: list[_Capsule], clouds: list[Cloud]) -> float:
    """max over n of h_capsules(n) − h_geoms(n), h the support function, in evenly spread directions [m]."""
    k = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / _DIRECTIONS, np.pi * (1 + 5**0.5) * k
    ways = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    reach = np.max([(c.ends @ ways).max(0) + c.radius for c in capsules], axis=0)
    filled = np.max([(c.points @ ways).max(0) + c.radius for c in clouds], axis=0)
    return float((reach - filled).max())
