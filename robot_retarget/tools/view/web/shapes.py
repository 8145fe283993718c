"""Visible shapes of a robot and of the bodies around it: geoms, and meshes reduced to the triangles that a page can show."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats, Ints, intervals
from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import parents_within
from robot_retarget.collision import Warnings
from robot_retarget.contact.stance import Stance
from robot_retarget.robot.body_distances import RobotAmongBodies
from robot_retarget.robot.geoms import collision_geoms
from robot_retarget.robot.kinematics import world_points
from robot_retarget.robot.model import Robot
from robot_retarget.robot.recognise import recognise
from robot_retarget.scene.geoms import CARTON, PREFIX, STANDING, moving_bodies, place_bodies
from robot_retarget.scene.scene import Scene
from robot_retarget.scene.shape import BodyShape, ShapeKind
from robot_retarget.tools.view.staging import LINK, METAL, Staging, height_of, linked, visible

_GEOM = mujoco.mjtGeom
KINDS = {
    int(_GEOM.mjGEOM_SPHERE): "sphere",
    int(_GEOM.mjGEOM_CAPSULE): "capsule",
    int(_GEOM.mjGEOM_ELLIPSOID): "ellipsoid",
    int(_GEOM.mjGEOM_CYLINDER): "cylinder",
    int(_GEOM.mjGEOM_BOX): "box",
    int(_GEOM.mjGEOM_MESH): "mesh",
}
TRIANGLES = 60_000
"""Largest number of triangles of all meshes of a robot: about one for each pixel that it covers."""
FEWEST = 40
"""Smallest number of triangles of a simplified mesh."""
PLAIN = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's colour of a geom without its own; the colour of its material replaces it."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A geom: kind, size as in MuJoCo, and pose in its body's frame."""

    body: int
    kind: str
    size: Floats
    """(3,) [m]."""
    position: Floats
    """(3,) [m]."""
    quaternion: Floats
    """(4,) w x y z."""
    colour: Floats
    """(4,) red, green, blue, alpha, 0 … 1."""
    mesh: tuple[Floats, Ints] | None = None
    """Vertices (V, 3) [m] and triangles (F, 3)."""


def shapes_of(robot: Robot, triangles: int = TRIANGLES) -> list[Shape]:
    """Return the visible geoms of a robot, the collision geoms of a body without visible ones, the links of a robot without geoms.

    Args:
        robot: the robot.
        triangles: limit of all meshes together; meshes are simplified evenly if the extra `view` is installed, else
            they are unchanged.
    """
    model = robot.model
    geoms = [int(geom) for geom in visible(model) if int(model.geom_type[geom]) in KINDS]
    counts = {
        g: int(model.mesh_facenum[model.geom_dataid[g]]) for g in geoms if model.geom_type[g] == _GEOM.mjGEOM_MESH
    }
    share = min(1.0, triangles / max(sum(counts.values()), 1))
    meshes = {g: _thinned(*_mesh(model, g), max(int(share * count), FEWEST)) for g, count in counts.items()}
    return [_shape(model, geom, meshes.get(geom)) for geom in geoms] + _links(robot)


def shapes_of_scene(scene: Scene) -> list[Shape]:
    """Return the bodies of a scene in their own frames, each under its index, without planes."""
    found = []
    for k, body in enumerate(scene.bodies):
        if body.shape.kind is not ShapeKind.PLANE:
            kind, size, mesh = _drawn(body.shape)
            colour = STANDING if body.fixed else CARTON
            still = np.zeros(3), np.array([1.0, 0, 0, 0])
            found.append(Shape(k, kind, np.array(size), *still, np.array(colour), mesh))
    return found


def _drawn(shape: BodyShape) -> tuple[str, list[float], tuple[Floats, Ints] | None]:
    """Return kind, size as in MuJoCo and mesh of a body's shape."""
    length, _, height = (shape.size / 2).tolist()
    match shape.kind:
        case ShapeKind.MESH:
            return "mesh", [0.0] * 3, (shape.vertices, shape.faces)
        case ShapeKind.HEIGHT_FIELD:
            return "mesh", [0.0] * 3, _field(shape)
        case ShapeKind.CYLINDER:
            return "cylinder", [length, height, 0.0], None
        case ShapeKind.SPHERE:
            return "sphere", [length, 0.0, 0.0], None
        case _:
            return "box", (shape.size / 2).tolist(), None


def _field(shape: BodyShape) -> tuple[Floats, Ints]:
    """Return the surface of a height field as a mesh."""
    rows, columns = shape.heights.shape
    x, y = np.meshgrid(
        *(np.linspace(-edge / 2, edge / 2, n) for edge, n in zip(shape.size, (columns, rows), strict=False))
    )
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    return np.stack([x, y, shape.heights], axis=2).reshape(-1, 3), faces


def _links(robot: Robot) -> list[Shape]:
    """Return a capsule from the origin of each linked body's parent to its own."""
    model, found = robot.model, []
    for body in linked(model).tolist():
        end = model.body_pos[body]
        length = float(np.linalg.norm(end))
        turn = Rotation.align_vectors([end], [[0, 0, 1]])[0] if length else Rotation.identity()
        size = np.array([LINK * height_of(robot), length / 2, 0.0])
        pose = end / 2, turn.as_quat(scalar_first=True)
        found.append(Shape(int(model.body_parentid[body]), "capsule", size, *pose, np.array(METAL)))
    return found


def _shape(model: mujoco.MjModel, geom: int, mesh: tuple[Floats, Ints] | None) -> Shape:
    material, own = int(model.geom_matid[geom]), model.geom_rgba[geom]
    colour = model.mat_rgba[material] if material >= 0 and np.allclose(own, PLAIN) else own
    place = model.geom_pos[geom], model.geom_quat[geom]
    return Shape(
        int(model.geom_bodyid[geom]), KINDS[int(model.geom_type[geom])], model.geom_size[geom], *place, colour, mesh
    )


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[Floats, Ints]:
    """Return the compiled vertices and triangles; coincident vertices are merged."""
    mesh = int(model.geom_dataid[geom])
    first, faces = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
    vertices = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
    triangles = model.mesh_face[faces : faces + int(model.mesh_facenum[mesh])]
    once, place = np.unique(np.asarray(vertices, float).round(6), axis=0, return_inverse=True)
    return once, place.ravel()[triangles]


def _thinned(vertices: Floats, triangles: Ints, most: int) -> tuple[Floats, Ints]:
    """Simplify a mesh to a number of triangles, by quadric edge collapse."""
    if len(triangles) <= most:
        return vertices, triangles
    try:
        from fast_simplification import simplify
    except ImportError:
        return vertices, triangles
    made = simplify(vertices, triangles.astype(np.int32), 1 - most / len(triangles))
    return np.asarray(made[0], float), np.asarray(made[1], np.int64)


# Layers over a robot in motion: keypoints, joints, footholds and support, near pairs.

PAIRS = 12
"""Largest number of shown pairs of links, the nearest first."""
NEAR_PAIR = 0.05
"""Pairs whose interaction distance is under this part of the robot's height are near."""


def keypoints_of(robot: Robot, qpos: Floats) -> tuple[tuple[str, ...], Floats, Ints] | None:
    """Return names (K), places (T, K, 3) [m] and bones (B, 2) of the keypoints at configurations (T, nq); None for a robot that is no humanoid."""
    try:
        anatomy = recognise(robot)
    except MatchError:
        return None
    names = anatomy.names
    bones = [(names.index(child), names.index(parent)) for child, parent in parents_within(names).items()]
    return names, world_points(robot, anatomy.points, qpos), np.array(bones).reshape(-1, 2)


def anchors(robot: Robot, qpos: Floats) -> Floats:
    """Return the places of the hinges (T, n, 3) at configurations (T, nq) [m]."""
    data, found = mujoco.MjData(robot.model), np.empty((len(qpos), len(robot.joint_ids), 3))
    for t, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(robot.model, data)
        found[t] = data.xanchor[robot.joint_ids]
    return found


def outline(corners: Floats) -> Floats:
    """Return the convex hull (N, 2) of points (M, 2), anticlockwise; points without an interior are returned unchanged [m]."""
    try:
        return corners[ConvexHull(corners).vertices]
    except (QhullError, ValueError):
        return corners


def footholds(stance: Stance) -> list[dict[str, Any]]:
    """Return every stretch of a foot on the floor, by feet, in order of time: frames, and outline and height of the sole points that carry [m].

    Args:
        stance: stance at the times of frames; the middle of a stretch gives its sole points.
    """
    found = []
    for k, name in enumerate(stance.feet.names):
        for first, stop in intervals(stance.touching[:, k]):
            middle = (first + stop - 1) // 2
            points = stance.points[middle, (stance.feet.owner == k) & stance.down[middle]]
            if len(points):
                sole, height = outline(points[:, :2]).round(4).tolist(), round(float(points[:, 2].mean()), 4)
                found.append({"foot": name, "first": first, "last": stop - 1, "outline": sole, "height": height})
    return found


def near_pairs(staging: Staging, warnings: Warnings) -> tuple[Ints, Floats]:
    """Return the pairs of links that come near (P,), as columns of the warnings, and the nearest points (T, P, 2, 3) of their surfaces [m].

    Distances are MuJoCo's of geoms; points are NaN in frames in which a pair is not near.

    Pairs that are near most of the time are neighbours by construction; they are shown during warnings only.

    Args:
        staging: robot and scene at all frames of the warnings.
        warnings: the warnings.
    """
    robot, qpos, scene = staging.robot, staging.qpos, staging.scene
    near = warnings.ahead < min(NEAR_PAIR * staging.height, warnings.reach)
    shown = (near & (near.mean(axis=0) < 0.5)) | warnings.flagged
    columns = np.flatnonzero(shown.any(axis=0))
    columns = columns[np.argsort(warnings.ahead[:, columns].min(axis=0), kind="stable")][:PAIRS]
    model = robot.model if scene is None else RobotAmongBodies(robot, scene).model
    data, around = mujoco.MjData(model), Scene(()) if scene is None else scene
    moving, poses = moving_bodies(model, around), around.poses(len(qpos))
    geoms = {robot.model.body(link).name: own for link, own in collision_geoms(robot).items()}
    geoms |= {name: [model.geom(PREFIX + name).id] for name in around.names}
    ends = np.full((len(qpos), len(columns), 2, 3), np.nan)
    for t in np.flatnonzero(shown[:, columns].any(axis=1)).tolist():
        data.qpos[:] = qpos[t]
        place_bodies(data, poses[t], moving)
        mujoco.mj_kinematics(model, data)
        for p in np.flatnonzero(shown[t, columns]).tolist():
            first, second = warnings.pairs[columns[p]]
            ends[t, p] = _nearest(model, data, geoms[first], geoms[second])
    return columns, ends


def _nearest(model: mujoco.MjModel, data: mujoco.MjData, first: list[int], second: list[int]) -> Floats:
    """Return the ends (2, 3) of the shortest line between two lists of geoms [m]; NaN from 1 m on."""
    best, line, found = np.inf, np.zeros(6), np.full(6, np.nan)
    for a in first:
        for b in second:
            distance = mujoco.mj_geomDistance(model, data, a, b, 1.0, line)
            if distance < min(best, 1.0):
                best, found = distance, line.copy()
    return found.reshape(2, 3)
