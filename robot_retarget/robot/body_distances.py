"""Distances between the links of a robot and the bodies of a scene, and their Jacobians, by MuJoCo.

The bodies are mocap bodies in the robot's model. Spheres around geoms find the pairs that may be near; `mj_geomDistance`
measures those. A mesh is its convex hull, and a height field has no distance: the height under each sole replaces it.
"""

from dataclasses import dataclass
from operator import itemgetter

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.robot.geoms import ON_SURFACE, solid_geoms
from robot_retarget.robot.model import Robot
from robot_retarget.scene.geoms import PREFIX, add_bodies, compiled, measured_bodies, moving_bodies, place_bodies
from robot_retarget.scene.scene import Scene

FACE = PREFIX + "a face"
"""The plane of a face that a link touches."""
ALIKE = 0.7
"""Cosine from which on a direction is that of a face: 45°."""
FACE_REACH = 10.0
"""Distances from faces are measured up to this [m]."""


@dataclass(frozen=True, eq=False)
class BodyDistances:
    """N pairs of a link's geom and a body near each other."""

    distance: Floats
    """(N,) [m], negative inside."""
    pairs: Ints
    """(N,) their link and body, as a place in `RobotAmongBodies.names`."""
    slope: Floats
    """(N, nv) of the distance by the tangent v."""


class RobotAmongBodies:
    """One robot among the bodies of a scene."""

    def __init__(self, robot: Robot, scene: Scene):
        """Compile the robot's model with the bodies.

        Raises:
            SceneError: a body's name is one of the robot's, or MuJoCo refuses its shape.
        """
        spec = robot.spec()
        add_bodies(spec, scene)
        face = spec.worldbody.add_body(name=FACE)  # after the robot's, so that its geoms keep their ids
        face.add_geom(name=FACE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.05], contype=0, conaffinity=0)
        self.model = compiled(spec, f"{scene.source} with {robot.name}")
        self.robot, self.scene, self.data = robot, scene, mujoco.MjData(self.model)
        self._moving = moving_bodies(self.model, scene)
        self._face = int(self.model.geom(FACE).id)
        self._bodies = measured_bodies(scene)
        self._body_geoms = np.array([self.model.geom(PREFIX + scene.names[b]).id for b in self._bodies], np.int64)
        solid = solid_geoms(robot)
        self._geoms = np.array([g for own in solid.values() for g in own], np.int64)
        self._links = np.array([link for link, own in solid.items() for _ in own], np.int64)
        self._pairs = np.arange(len(scene))[self._bodies] * len(solid)
        self._columns = np.array([k for k, own in enumerate(solid.values()) for _ in own], np.int64)
        self.names: list[tuple[str, str]] = [(robot.model.body(k).name, name) for name in scene.names for k in solid]
        """Names of the link and the body of every pair of the P that are measured."""
        self._radii = np.asarray(self.model.geom_rbound)[self._geoms][:, None]
        middle, half = np.asarray(self.model.geom_aabb)[self._body_geoms].reshape(-1, 2, 3).transpose(1, 0, 2)
        plane = np.asarray(self.model.geom_type)[self._body_geoms] == mujoco.mjtGeom.mjGEOM_PLANE
        self._low = np.where(plane[:, None], -np.inf, middle - half)
        """(B, 3) ends of the boxes around the bodies, in their frames [m]: a plane bounds the half space below it."""
        self._high = np.where(plane[:, None], [np.inf, np.inf, 0.0], middle + half)
        self._placed = b""
        self._known: tuple[bytes, float, BodyDistances] | None = None

    def near(self, qpos: Floats, poses: Floats, reach: float) -> BodyDistances:
        """Return the pairs within a reach.

        Args:
            qpos: (nq,) configuration of the robot.
            poses: (B, 7) of the bodies.
            reach: [m].
        """
        key = qpos.tobytes() + poses.tobytes()
        if self._known is None or self._known[:2] != (key, reach):
            self._known = key, reach, self._measured(qpos, poses, reach)
        return self._known[2]

    def along(self, path: Floats, poses: Floats, reach: float) -> Floats:
        """Return the distances (T, P) of the pairs at configurations (T, nq) and poses (T, B, 7) [m], at most the reach [m]."""
        found = np.full((len(path), len(self.names)), reach)
        for row, q, placed in zip(found, path, poses, strict=True):
            near = self.near(q, placed, reach)
            np.minimum.at(row, near.pairs, near.distance)
        return found

    def geoms_of(self, links: Ints) -> list[int]:
        """Return the solid geoms of links."""
        return self._geoms[np.isin(self._links, links)].tolist()

    def to_face(
        self, qpos: Floats, poses: Floats, geoms: list[int], face: tuple[Floats, Floats]
    ) -> tuple[float, Floats]:
        """Return the least distance of geoms from the plane of a face, negative behind it [m], and its slope (nv,) by the tangent v.

        Args:
            qpos: (nq,) configuration of the robot.
            poses: (B, 7) of the bodies.
            geoms: of the robot, one or more.
            face: a point (3,) [m] and the outward unit normal (3,).
        """
        self.place(qpos, poses)
        place, normal = face
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, normal)
        mujoco.mju_quat2Mat(self.data.geom_xmat[self._face], turn)
        self.data.geom_xpos[self._face] = place
        least, geom, ends = min((self._between(self._face, geom, FACE_REACH) for geom in geoms), key=itemgetter(0))
        return least, self._slope(geom, ends[3:], normal)

    def to_side(
        self, qpos: Floats, poses: Floats, geoms: list[int], body: int, face: tuple[Floats, Floats]
    ) -> tuple[float, Floats]:
        """Return the least distance of geoms from a body, where its direction is that of a face; else from the plane of the face.

        A hand that overhangs a small face would meet the plane outside the body.

        Args:
            body: index in the scene; the other arguments are those of `to_face`.
        """
        if body in self._bodies:
            self.place(qpos, poses)
            own = int(self._body_geoms[self._bodies.index(body)])
            least, geom, ends = min((self._between(own, geom, FACE_REACH) for geom in geoms), key=itemgetter(0))
            way = _way(ends, least) if abs(least) > ON_SURFACE else face[1]
            if way @ face[1] > ALIKE:
                return least, self._slope(geom, ends[3:], way)
        return self.to_face(qpos, poses, geoms, face)

    def point(self, body: int, offset: Floats) -> tuple[Floats, Floats]:
        """Return the place (3,) [m] and the Jacobian (3, nv) of a point of a link in the last measured configuration."""
        place = self.data.xpos[body] + self.data.xmat[body].reshape(3, 3) @ offset
        slope = np.empty((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, slope, None, place, body)
        return place, slope

    def _measured(self, qpos: Floats, poses: Floats, reach: float) -> BodyDistances:
        self.place(qpos, poses)
        data = self.data
        turn = data.geom_xmat[self._body_geoms].reshape(-1, 3, 3)
        way = data.geom_xpos[self._geoms][:, None] - data.geom_xpos[self._body_geoms]
        at = np.einsum("bij,gbi->gbj", turn, way)
        out = np.maximum(np.maximum(self._low - at, at - self._high), 0.0)
        near = np.sqrt((out * out).sum(axis=2)) - self._radii < reach
        return self._rows(np.argwhere(near).tolist(), reach)

    def place(self, qpos: Floats, poses: Floats) -> None:
        """Put the robot and the bodies where a configuration (nq,) and poses (B, 7) have them."""
        key = qpos.tobytes() + poses.tobytes()
        if key == self._placed:
            return
        self._placed = key
        self.data.qpos[:] = qpos
        place_bodies(self.data, poses, self._moving)
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def _rows(self, pairs: list[list[int]], reach: float) -> BodyDistances:
        """Return the distances of pairs of a solid geom and a body that are within reach, with their slopes."""
        measured = [(k, b, *self._between(int(self._body_geoms[b]), int(self._geoms[k]), reach)) for k, b in pairs]
        found = [one for one in measured if one[2] < reach and abs(one[2]) > ON_SURFACE]
        slope = np.empty((len(found), self.model.nv))
        for row, (_, _, least, geom, ends) in zip(slope, found, strict=True):
            row[:] = self._slope(geom, ends[3:], _way(ends, least))
        names = np.array([self._pairs[b] + self._columns[k] for k, b, *_ in found], np.int64)
        return BodyDistances(np.array([one[2] for one in found]), names, slope)

    def _between(self, own: int, geom: int, reach: float) -> tuple[float, int, Floats]:
        """Return the distance from a geom to one of the robot [m], the latter, and the nearest points of both (6,) [m]."""
        ends = np.zeros(6)
        return mujoco.mj_geomDistance(self.model, self.data, own, geom, reach, ends), geom, ends

    def _slope(self, geom: int, place: Floats, way: Floats) -> Floats:
        """Return by how much a place (3,) of a geom moves along a direction (3,) with the tangent v (nv,)."""
        jacobian = np.empty((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, place, int(self.model.geom_bodyid[geom]))
        return way @ jacobian


def _way(ends: Floats, distance: float) -> Floats:
    """Return the direction (3,) from the first of two nearest points (6,) to the second, at a distance that is not 0."""
    return (ends[3:] - ends[:3]) / distance
