"""The tree of rigid links of a robot in one pose: parents, hinge axes and surfaces.

A link is a body together with everything welded to it. All positions are in the world frame.
"""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from math import fsum

import mujoco
import numpy as np

from robot_retarget.base.arrays import ALIGNED, Floats, Ints, path_to_root
from robot_retarget.robot.model import Robot

RANK = 1e-6
"""Singular values below this share of the largest are zero [-]: of lines and constraints that meet but for the rounding of
model files."""
STUB = 0.16
"""Share of a link's reach below which its solid geoms are a ball about its joint [-]: .10 on TienKung 2 lite's forearms; .27 and
more on the ends of 25 other robots."""
_GEOM = mujoco.mjtGeom
_CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_GRID = np.array(list(itertools.product(np.linspace(-1, 1, 5), repeat=3)))
_SPHERE = _GRID[np.abs(_GRID).max(1) == 1]
_SPHERE = _SPHERE / np.linalg.norm(_SPHERE, axis=1, keepdims=True)
_DISC = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8), np.zeros(16)], 1)


@dataclass(frozen=True)
class Axis:
    """The line a hinge turns about."""

    joint: int
    """Joint id in the model."""
    link: int
    """The link it carries."""
    anchor: Floats
    """(3,) a point of the line that does not depend on the place of the joint in the model (`Links.axes`) [m]."""
    direction: Floats

    def nearest(self, point: Floats) -> Floats:
        """The point of the line nearest to `point`."""
        return self.anchor + self.direction * (self.direction @ (point - self.anchor))

    def at_coordinate(self, point: Floats, lateral: Floats) -> Floats:
        """Return the point x of the axis with lateral · x = lateral · point.

        Args:
            point: (3,) [m].
            lateral: (3,) unit vector, not perpendicular to the axis.

        Returns:
            (3,) [m].
        """
        return self.anchor + self.direction * float(lateral @ (point - self.anchor) / (lateral @ self.direction))

    def distance(self, point: Floats) -> float:
        """From `point` to the line [m]."""
        return float(np.linalg.norm(point - self.nearest(point)))


def _nearest_on(axis: Axis, others: list[Axis]) -> Floats:
    """The point of an axis nearest to other lines in the least squares."""
    across = [np.eye(3) - np.outer(a.direction, a.direction) for a in others]
    pull = fsum(float(axis.direction @ p @ (a.anchor - axis.anchor)) for p, a in zip(across, others, strict=True))
    return axis.anchor + axis.direction * (pull / fsum(float(axis.direction @ p @ axis.direction) for p in across))


def meeting_point(axes: list[Axis], near: Floats) -> Floats:
    """The point nearest to all lines in the least squares; where that leaves freedom, the one nearest to `near`.

    Args:
        axes: lines.
        near: (3,) [m].
    """
    projectors = [np.eye(3) - np.outer(a.direction, a.direction) for a in axes]
    normal = sum(projectors, np.zeros((3, 3)))
    pull = sum((p @ (a.anchor - near) for p, a in zip(projectors, axes, strict=True)), np.zeros(3))
    return near + np.linalg.pinv(normal, rcond=RANK) @ pull


class Links:
    """The link tree of a robot, in its reference pose `qpos0` unless another is given."""

    robot: Robot
    model: mujoco.MjModel

    def __init__(self, robot: Robot, qpos: Floats | None = None):
        self.robot, self.model = robot, robot.model
        self.data: mujoco.MjData = mujoco.MjData(self.model)
        if qpos is not None:
            self.data.qpos[:] = qpos
        mujoco.mj_forward(self.model, self.data)
        self.weld: Ints = np.asarray(self.model.body_weldid)
        self.root: int = int(self.weld[robot.root_body])
        own, parents = range(1, self.model.nbody), self.model.body_parentid
        self.ids: list[int] = [b for b in own if self.weld[b] == b and self.root in path_to_root(parents, b)]
        if self.root not in self.ids:
            self.ids.insert(0, self.root)

    def parent(self, link: int) -> int:
        """The link that carries `link`."""
        return int(self.weld[self.model.body_parentid[link]])

    @cached_property
    def children(self) -> dict[int, list[int]]:
        """Links by the link that carries them."""
        table: dict[int, list[int]] = {link: [] for link in self.ids}
        for link in self.ids:
            if link != self.root:
                table[self.parent(link)].append(link)
        return table

    def links_of(self, body: int) -> list[int]:
        """The link a body belongs to and all that it carries, itself first."""
        found = [int(self.weld[body])]
        for link in found:
            found += self.children[link]  # grows while it is walked through
        return found

    @cached_property
    def leaves(self) -> list[int]:
        """Links that carry no other."""
        return [link for link in self.ids if not self.children[link] and link != self.root]

    def path(self, link: int) -> list[int]:
        """The links from the root to `link`, both included."""
        line = [link]
        while line[-1] != self.root:
            line.append(self.parent(line[-1]))
        return line[::-1]

    @cached_property
    def axes(self) -> dict[int, list[Axis]]:
        """The hinges that carry each link, from the parent's side on.

        The place of a joint along its axis is arbitrary. The anchor is therefore the point nearest to the axes of the
        next hinges that are not parallel, or of the previous ones at the end of a chain.
        """
        return {link: [self._settled(axis, k) for k, axis in enumerate(lines)] for link, lines in self._lines.items()}

    @cached_property
    def _lines(self) -> dict[int, list[Axis]]:
        """The hinges that carry each link, anchored where the model has them."""
        at, turned = self.data.xanchor.copy(), self.data.xaxis.copy()
        bodies = [(int(j), int(self.model.jnt_bodyid[j])) for j in self.robot.joint_ids]
        return {link: [Axis(j, link, at[j], turned[j]) for j, body in bodies if body == link] for link in self.ids}

    def _settled(self, axis: Axis, place: int) -> Axis:
        """Return an axis anchored near its neighbours, or near the surface of its link; `place` is its index on the link."""
        own = self._lines[axis.link]
        after, before = own[place + 1 :], [a for link in self.path(axis.link)[:-1] for a in self._lines[link]]
        groups = [[a] for a in after] + self._below(axis.link) + [[a] for a in reversed(before + own[:place])]
        for group in groups:
            crossing = [a for a in group if abs(a.direction @ axis.direction) < ALIGNED]
            if crossing:
                return replace(axis, anchor=_nearest_on(axis, crossing))
        return replace(axis, anchor=axis.nearest(self.surface(axis.link).mean(0)))

    def _below(self, link: int) -> list[list[Axis]]:
        """The hinges of all links that a link carries, those as many links away together."""
        level, found = self.children[link], []
        while level:
            found.append([a for child in level for a in self._lines[child]])
            level = [c for child in level for c in self.children[child]]
        return found

    def axes_along(self, links: list[int]) -> list[Axis]:
        """The hinges of a chain of links, in order."""
        return [axis for link in links for axis in self.axes[link]]

    def bodies(self, link: int) -> list[int]:
        """The bodies of a link."""
        return [int(b) for b in np.flatnonzero(self.weld == link)]

    def origin(self, link: int) -> Floats:
        """The link's body origin. (3,)"""
        return self.data.xpos[link].copy()

    def surface(self, link: int, seen: bool = False) -> Floats:
        """Points (P, 3) on the solid geoms of a link, or on all that are `seen`; its origin when it has no geom.

        Args:
            link: id of the link.
            seen: whether geoms that do not collide count.
        """
        geoms = [int(g) for b in self.bodies(link) for g in np.flatnonzero(self.model.geom_bodyid == b)]
        clouds = [self.geom_points(g) for g in (geoms if seen else self.solid(geoms))]
        return np.concatenate(clouds) if clouds else self.origin(link)[None]

    def extent(self, link: int) -> Floats:
        """Points (P, 3) of a link's surface, and the origins of welded bodies without geoms: a hand may be a frame alone.

        Solid geoms with a reach below `STUB` of that of the visible geoms model the joint alone; the surface is then that of the visible geoms.
        """
        frames = [b for b in self.bodies(link) if b != link and b not in self.model.geom_bodyid]
        solid, seen = (self.surface(link, seen=seen) for seen in (False, True))
        reach, whole = (np.linalg.norm(cloud - self.origin(link), axis=1).max() for cloud in (solid, seen))
        return np.concatenate([solid if reach > STUB * whole else seen, self.data.xpos[frames]])

    def solid(self, geoms: list[int]) -> list[int]:
        """The geoms that take part in contacts, or all when none does."""
        colliding = [g for g in geoms if self.model.geom_contype[g] or self.model.geom_conaffinity[g]]
        return colliding or geoms

    def geom_points(self, geom: int) -> Floats:
        """Points (P, 3) that span a geom: mesh vertices, box corners, the extremes of round shapes."""
        local = local_points(self.model, geom)
        return local @ self.data.geom_xmat[geom].reshape(3, 3).T + self.data.geom_xpos[geom]

    def local(self, body: int, point: Floats) -> Floats:
        """A world point in a body's frame.

        Args:
            body: id of the body.
            point: (3,) in the world [m].
        """
        return (point - self.data.xpos[body]) @ self.data.xmat[body].reshape(3, 3)

    def place(self, body: int, offset: Floats) -> Floats:
        """Where a point of a body's frame is in the world.

        Args:
            body: id of the body.
            offset: (3,) in the body's frame [m].
        """
        return self.data.xpos[body] + self.data.xmat[body].reshape(3, 3) @ offset

    def words(self, link: int, fixed: bool = True) -> str:
        """The names of a link's joints and of its body, or of all bodies `fixed` to it, for a human eye or a search."""
        model = self.model
        joints = range(model.body_jntadr[link], model.body_jntadr[link] + model.body_jntnum[link])
        bodies = self.bodies(link) if fixed else [link]
        return " ".join([model.body(b).name for b in bodies] + [model.joint(j).name for j in joints])


def local_points(model: mujoco.MjModel, geom: int) -> Floats:
    """Points (P, 3) that span a geom, in its own frame [m].

    Args:
        model: the compiled model.
        geom: id of the geom.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]  # NumPy's own integers are in no tuple of kinds
    if kind == _GEOM.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        return np.array(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], dtype=float)
    if kind == _GEOM.mjGEOM_BOX:
        return _CUBE * size
    if kind == _GEOM.mjGEOM_CYLINDER:
        rim = _DISC * size[0]
        return _both_ends(rim, size[1])
    if kind == _GEOM.mjGEOM_CAPSULE:
        return _both_ends(_ball(np.full(3, size[0])), size[1])
    if kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID):
        return _ball(size if kind == _GEOM.mjGEOM_ELLIPSOID else np.full(3, size[0]))
    return np.zeros((1, 3))


def _both_ends(cap: Floats, half: float) -> Floats:
    along = np.array([0.0, 0.0, half])
    return np.concatenate([cap + along, cap - along])


def _ball(radii: Floats) -> Floats:
    return _SPHERE * radii
