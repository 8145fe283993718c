"""Bodies as geoms of MuJoCo, in a robot's model or alone to measure distances and heights; the ground on which a robot stands."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.errors import SceneError
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import BodyShape, ShapeKind, mesh

PREFIX = "scene: "
"""Bodies and geoms of a scene have this before their name in a robot's model."""
PROBE = 1e-5
"""Radius of the point from which distances are measured [m]."""
CARTON = (0.76, 0.6, 0.42, 1.0)
"""Colour of bodies that move in pictures: red, green, blue, alpha."""
STANDING = (0.62, 0.66, 0.7, 1.0)
"""Colour of bodies at rest."""
FLOOR_TYPE = 2
"""Contact type of a floor for bodies alone."""
BASE = 0.01
"""Thickness of a height field under its lowest point [m]: MuJoCo requires one, and nothing comes there."""
MESH_FILE = 10 << 20
"""Largest mesh file, 200,000 faces in STL, as MuJoCo's limit; the hull of as many takes seconds [bytes]."""
_GEOM = mujoco.mjtGeom
_TYPES = {
    ShapeKind.BOX: _GEOM.mjGEOM_BOX,
    ShapeKind.CYLINDER: _GEOM.mjGEOM_CYLINDER,
    ShapeKind.SPHERE: _GEOM.mjGEOM_SPHERE,
    ShapeKind.PLANE: _GEOM.mjGEOM_PLANE,
    ShapeKind.MESH: _GEOM.mjGEOM_MESH,
    ShapeKind.HEIGHT_FIELD: _GEOM.mjGEOM_HFIELD,
}


def add_bodies(spec: mujoco.MjSpec, scene: Scene, free: bool = False) -> None:
    """Add the bodies of a scene to a specification, each with one geom of the same name.

    Fixed bodies become static. Moving bodies become mocap bodies, in the order of the scene, or, if `free`, bodies with a
    free joint and their mass.
    """
    for body in scene.bodies:
        name, pose = PREFIX + body.name, body.poses if body.poses.ndim == 1 else body.poses[0]
        own = spec.worldbody.add_body(name=name, pos=pose[:3], quat=pose[3:], mocap=not (body.fixed or free))
        if free and not body.fixed:
            own.add_freejoint(name=name)
        geom = own.add_geom(name=name, type=_TYPES[body.shape.kind], friction=[body.friction, 0.005, 0.0001])
        geom.mass, geom.rgba = body.weight, list(STANDING if body.fixed else CARTON)
        geom.conaffinity = 1 | FLOOR_TYPE
        _give_shape(spec, geom, body)


def add_floor(spec: mujoco.MjSpec, model: mujoco.MjModel) -> bool:
    """Add a plane z = 0 where the model of a specification has no plane or height field; return whether it was added."""
    if np.isin(model.geom_type, (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD)).any():
        return False
    spec.worldbody.add_geom(type=_GEOM.mjGEOM_PLANE, size=[0, 0, 0.05], contype=1, conaffinity=0xFFFF)
    return True


def add_floor_of_bodies(spec: mujoco.MjSpec) -> None:
    """Add a floor z = 0 that bodies touch and the robot does not: for a robot that is carried in the air."""
    floor = spec.worldbody.add_body(name="the floor of the bodies")
    floor.add_geom(type=_GEOM.mjGEOM_PLANE, size=[0, 0, 0.05], contype=FLOOR_TYPE, conaffinity=0)


def _give_shape(spec: mujoco.MjSpec, geom: mujoco.MjsGeom, body: RigidBody) -> None:
    shape, name = body.shape, PREFIX + body.name
    length, _, height = shape.size.tolist()
    match shape.kind:
        case ShapeKind.MESH:
            asset = spec.add_mesh(name=name, uservert=shape.vertices.ravel(), userface=shape.faces.ravel())
            asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.meshname = name
        case ShapeKind.HEIGHT_FIELD:
            (rows, columns), (low, size) = shape.heights.shape, field_size(shape)
            spec.add_hfield(name=name, nrow=rows, ncol=columns, size=size, userdata=(shape.heights - low).ravel())
            geom.hfieldname, geom.pos = name, np.array([0, 0, low])
        case ShapeKind.CYLINDER:
            geom.size = np.array([length / 2, height / 2, 0])
        case ShapeKind.PLANE:
            geom.size = np.array([0, 0, 0.05])
        case _:
            geom.size = shape.size / 2


def field_size(shape: BodyShape) -> tuple[float, list[float]]:
    """Return the lowest height of a height field, and its size in MuJoCo, whose heights begin at 0 [m]."""
    low, (length, width, height) = float(shape.heights.min()), shape.size.tolist()
    return low, [length / 2, width / 2, max(height - low, BASE), low + BASE]


def read_mesh(path: Path, scale: float = 1.0) -> BodyShape:
    """Return the mesh of an OBJ or STL file.

    Raises:
        SceneError: it is too large, or MuJoCo does not read it.
    """
    size = path.stat().st_size
    if size > MESH_FILE:
        raise SceneError(f"{path} has {size >> 20} MB, more than {MESH_FILE >> 20}: reduce its faces")
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(path.resolve()), scale=[scale] * 3)
    spec.worldbody.add_geom(type=_GEOM.mjGEOM_MESH, meshname="mesh")
    return mesh_of(compiled(spec, path), 0)


def mesh_of(model: mujoco.MjModel, geom: int) -> BodyShape:
    """Return the mesh of a geom, in the frame of the geom's body."""
    number = int(model.geom_dataid[geom])
    first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
    faces = int(model.mesh_faceadr[number])
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    vertices = model.mesh_vert[first : first + count] @ turn.reshape(3, 3).T + model.geom_pos[geom]
    return mesh(vertices, model.mesh_face[faces : faces + int(model.mesh_facenum[number])])


def compiled(spec: mujoco.MjSpec, source: Path | str) -> mujoco.MjModel:
    """Return the model of a specification with bodies of a source; raise SceneError where MuJoCo refuses it."""
    try:
        return spec.compile()
    except ValueError as error:
        raise SceneError(f"{source}: MuJoCo does not load it: {' '.join(str(error).split())}") from error


class SceneModel:
    """A scene alone in MuJoCo: nearest points on its bodies and heights of its surfaces."""

    def __init__(self, scene: Scene):
        """Compile the bodies of a scene whose poses are known."""
        spec = mujoco.MjSpec()
        add_bodies(spec, scene)
        probe = spec.worldbody.add_body(name="probe", mocap=True)
        probe.add_geom(name="probe", type=_GEOM.mjGEOM_SPHERE, size=[PROBE, 0, 0])
        self.scene, self.model = scene, compiled(spec, scene.source)
        self.data = mujoco.MjData(self.model)
        self._probe = self.model.geom("probe").id
        self._geoms = [self.model.geom(PREFIX + name).id for name in scene.names]
        self._groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
        self._mocap = moving_bodies(self.model, scene)
        self._place = int(self.model.body_mocapid[self.model.body("probe").id])

    def nearest(self, points: Floats, poses: Floats, reach: float) -> tuple[Floats, Floats]:
        """Measure points against every body.

        Args:
            points: (T, K, 3) in the world [m].
            poses: (T, B, 7) of the bodies.
            reach: points farther away are reported at this distance [m].

        Returns:
            Signed distances (T, K, B) [m], negative inside, and the nearest point on the surface (T, K, B, 3) in the world
            [m], the point itself if it is out of reach. Height fields have no distance.
        """
        count = len(self._geoms)
        distance = np.full((*points.shape[:2], count), reach)
        place = np.repeat(points[:, :, None], count, axis=2)
        ends = np.zeros(6)
        measured = measured_bodies(self.scene)
        for t, k in np.ndindex(*points.shape[:2]):
            self._pose(poses[t], points[t, k])
            for b in measured:
                found = mujoco.mj_geomDistance(self.model, self.data, self._geoms[b], self._probe, reach, ends)
                if found < reach:
                    distance[t, k, b], place[t, k, b] = found + PROBE, ends[:3]
        return distance, place

    def heights(self, points: Floats, poses: Floats, above: float) -> tuple[Floats, Floats, Ints]:
        """Find the surface under points: a ray straight down from `above` them.

        Args:
            points: (T, K, 3) in the world [m].
            poses: (T, B, 7) of the bodies.
            above: where the rays start over the points [m].

        Returns:
            Heights of the surface (T, K) [m], 0 where only the floor is below; its upward normals (T, K, 3); and the body
            (T, K), −1 for the floor.
        """
        height, normal = np.zeros(points.shape[:2]), np.zeros(points.shape)
        normal[..., 2] = 1.0
        body, geom, way = np.full(points.shape[:2], -1), np.zeros(1, np.int32), np.zeros(3)
        down, lift = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, above])
        for t in range(len(points)):
            self._pose(poses[t], np.array([0.0, 0.0, -1e6]))
            for k, point in enumerate(points[t]):
                start = point + lift
                gone = mujoco.mj_ray(self.model, self.data, start, down, self._groups, 1, -1, geom, way)
                top = start[2] - gone
                if gone >= 0 and top > 0 and way[2] > 0:
                    height[t, k], normal[t, k], body[t, k] = top, way, self._geoms.index(int(geom[0]))
        return height, normal, body

    def _pose(self, poses: Floats, probe: Floats) -> None:
        place_bodies(self.data, poses, self._mocap)
        self.data.mocap_pos[self._place] = probe
        mujoco.mj_kinematics(self.model, self.data)


def scene_geoms(model: mujoco.MjModel) -> Ints:
    """Return the geoms of a scene in a model."""
    return np.array([g for g in range(model.ngeom) if model.geom(g).name.startswith(PREFIX)], np.int64)


def measured_bodies(scene: Scene) -> list[int]:
    """Return the indices of the bodies that have a distance in MuJoCo: all but height fields."""
    return [k for k, body in enumerate(scene.bodies) if body.shape.kind is not ShapeKind.HEIGHT_FIELD]


def moving_bodies(model: mujoco.MjModel, scene: Scene) -> Ints:
    """Return (M, 2) mocap ids in a model and indices in its scene of the bodies that move."""
    ids = [int(model.body_mocapid[model.body(PREFIX + name).id]) for name in scene.names]
    return np.array([(mocap, k) for k, mocap in enumerate(ids) if mocap >= 0], np.int64).reshape(-1, 2)


def place_bodies(data: mujoco.MjData, poses: Floats, moving: Ints) -> None:
    """Set the mocap bodies of a scene to poses (B, 7), with the table of `moving_bodies`."""
    if not len(moving):
        return
    ids, bodies = moving.T
    data.mocap_pos[ids], data.mocap_quat[ids] = poses[bodies, :3], poses[bodies, 3:]


SUNK = 0.02
"""Surfaces up to this height over a sole are under it: it sinks in a little [m]. Half and double find the same ground
on the three sample scenes."""
SIDE = 5
"""Points along each side of a sole that find its part on a surface that is smaller ..."""
HALVINGS = 6
"""... whose edge is found by halving the way between them: a millimetre on a sole of 25 cm."""
RESTING = 0.003
"""Points this much higher than the lowest one rest on the ground as well [m]. Half and double find the same ground on
the three sample scenes."""
SOLE_DECIMALS = 4
"""Soles that agree to this number of decimals stand alike [m]: to 0.1 mm."""


@dataclass(frozen=True, eq=False)
class SolidGround:
    """The floor and the bodies at rest; bodies that move carry no feet."""

    scene: Scene | None = None
    _known: dict[bytes, tuple[Floats, Floats, Floats]] = field(default_factory=dict, repr=False)

    @cached_property
    def _model(self) -> SceneModel | None:
        bodies = () if self.scene is None else tuple(body for body in self.scene.bodies if body.fixed)
        return SceneModel(replace(self.scene, bodies=bodies)) if self.scene and bodies else None

    @property
    def level(self) -> bool:
        """Whether there is nothing but the floor."""
        return self._model is None

    def under(self, points: Floats, above: float = SUNK) -> tuple[Floats, Floats]:
        """Return heights (T, K) [m] and upward normals (T, K, 3) of the ground under points.

        Args:
            points: (T, K, 3) [m].
            above: surfaces up to this height over a point are under it [m].
        """
        if self._model is None:
            return np.zeros(points.shape[:2]), np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        heights, normals, _ = self._model.heights(points, self._model.scene.poses(len(points)), above)
        return heights, normals

    def over(self, points: Floats, above: float = SUNK) -> Floats:
        """Return heights (T, K) of points (T, K, 3) over the ground under them [m]; `above` as in `under`."""
        return points[..., 2] - self.under(points, above)[0]

    def plane(self, points: Floats, above: float) -> tuple[Floats, Floats]:
        """Return a point (3,) [m] and the normal (3,) of the surface on which points (P, 3) stand: under them, that nearest in height.

        Args:
            points: of a sole [m].
            above: surfaces up to this height over them are under them [m].
        """
        heights, normals = (found[0] for found in self.under(points[None], above))
        nearest = int(np.abs(heights - points[:, 2].mean()).argmin())
        return np.append(points[nearest, :2], heights[nearest]), normals[nearest]

    def footing(self, sole: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (P, 3) that span the part of a sole on the ground [m], their heights over it (P,) [m] and its normals (P, 3).

        On the floor they are the corners. Elsewhere the sole may be larger than the surface under it.

        Args:
            sole: (4, 3) corners [m].
        """
        if self.level:
            return sole, sole[:, 2], np.broadcast_to([0.0, 0.0, 1.0], sole.shape)
        key = sole.round(SOLE_DECIMALS).tobytes()
        if key not in self._known:
            self._known[key] = self._footing(sole)
        return self._known[key]

    def _footing(self, sole: Floats) -> tuple[Floats, Floats, Floats]:
        points = filled(sole)
        heights = self.over(points[None])[0]
        highest = float(heights.min()) + RESTING
        edge = self._edge(points.reshape(SIDE, SIDE, 3), (heights < highest).reshape(SIDE, SIDE), highest)
        points = np.concatenate([points[heights < highest], edge])
        with suppress(QhullError, ValueError):  # a point or a line has no hull
            points = points[ConvexHull(points[:, :2]).vertices]
        under, normals = (found[0] for found in self.under(points[None]))
        return points, points[:, 2] - under, normals

    def _edge(self, points: Floats, rests: Bools, highest: float) -> Floats:
        """Return the last resting points (E, 3) between neighbours (SIDE, SIDE, 3) of which one rests: under `highest` over the ground [m]."""
        pairs = [
            (points[:-1], points[1:], rests[:-1], rests[1:]),
            (points[:, :-1], points[:, 1:], rests[:, :-1], rests[:, 1:]),
        ]
        inner = np.concatenate([np.where(a[..., None], p, q)[a != b] for p, q, a, b in pairs])
        outer = np.concatenate([np.where(a[..., None], q, p)[a != b] for p, q, a, b in pairs])
        for _ in range(HALVINGS if len(inner) else 0):
            middle = (inner + outer) / 2
            stands = (self.over(middle[None])[0] < highest)[:, None]
            inner, outer = np.where(stands, middle, inner), np.where(stands, outer, middle)
        return inner


def filled(soles: Floats) -> Floats:
    """Return (…, SIDE², 3) points in rows over soles (…, 4, 3), whose corners are front left, front right, rear left, rear right."""
    front, left = (share.ravel() for share in np.meshgrid(*2 * [np.linspace(0.0, 1.0, SIDE)], indexing="ij"))
    shares = np.stack([front * left, front * (1 - left), (1 - front) * left, (1 - front) * (1 - left)], axis=1)
    return shares @ soles
