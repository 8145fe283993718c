"""A scene as arrays of a trajectory file."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import SceneError
from robot_retarget.base.untrusted.arrays import Field
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import BodyShape, ShapeKind

FIELDS = {
    "scene_names": Field("text", ("B",), required=False),
    "scene_shapes": Field("text", ("B",), required=False),
    "scene_sizes": Field("number", ("B", 3), required=False),
    "scene_poses": Field("number", ("T", "B", 7), required=False),
    "scene_fixed": Field("integer", ("B",), bounds=(0, 1), required=False),
    "scene_mass": Field("number", ("B",), required=False),
    "scene_friction": Field("number", ("B",), required=False),
    "scene_vertices": Field("number", ("V", 3), required=False),
    "scene_faces": Field("integer", ("F", 3), required=False),
    "scene_heights": Field("number", ("H",), required=False),
    "scene_counts": Field("integer", ("B", 4), required=False),
    "scene_scale": Field("number", bounds=(0, np.inf), required=False),
    "scene_world": Field("number", (3,), required=False),
}
"""Of the trajectory file: per body its name, shape, edges [m], poses, whether it is fixed, mass [kg] and friction; the vertices,
faces and heights of all bodies one after the other, and per body the numbers of vertices, faces, rows and columns; and the size over
the captured one, 0 or none of bodies that are scaled with the human, and the map from the human's floor, 0 or none where it is not known."""
OPTIONAL = ("scene_scale", "scene_world")
"""Fields that older files lack."""


def arrays_of(scene: Scene, frames: int) -> dict[str, Any]:
    """Return the arrays of a scene whose moving bodies have poses at every frame."""
    bodies, shapes = scene.bodies, [body.shape for body in scene.bodies]
    return {
        "scene_names": np.array(scene.names, dtype=np.str_),
        "scene_shapes": np.array([str(shape.kind) for shape in shapes], dtype=np.str_),
        "scene_sizes": np.array([shape.size for shape in shapes]).reshape(-1, 3),
        "scene_poses": scene.poses(frames),
        "scene_fixed": np.array([body.fixed for body in bodies], dtype=np.int64),
        "scene_mass": np.array([body.weight for body in bodies]),
        "scene_friction": np.array([body.friction for body in bodies]),
        "scene_vertices": np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in shapes)]),
        "scene_faces": np.concatenate([np.zeros((0, 3), np.int64), *(shape.faces for shape in shapes)]),
        "scene_heights": np.concatenate([np.zeros(0), *(shape.heights.ravel() for shape in shapes)]),
        "scene_counts": np.array([[len(s.vertices), len(s.faces), *s.heights.shape] for s in shapes]).reshape(-1, 4),
        "scene_scale": scene.scale or 0.0,
        "scene_world": np.array(scene.world or (0.0, 0.0, 0.0)),
    }


def scene_from(values: Mapping[str, Any]) -> Scene | None:
    """Return the scene of the fields of a file; None without one.

    Raises:
        SceneError: a field is missing, a shape is unknown, or the numbers of a mesh do not fit.
    """
    if "scene_names" not in values:
        return None
    missing = next((name for name in FIELDS if name not in (*values, *OPTIONAL)), None)
    if missing is not None:
        raise SceneError(f"no key {missing!r}, which belongs to a scene")
    counts, poses = values["scene_counts"], np.asarray(values["scene_poses"], float)
    starts = np.concatenate([np.zeros((1, 3), int), np.cumsum(_numbers(counts), axis=0)])
    if (counts < 0).any() or starts[-1].tolist() != [
        len(values[f"scene_{k}"]) for k in ("vertices", "faces", "heights")
    ]:
        raise SceneError("scene_counts does not fit the vertices, faces and heights")
    shapes = [_shape(values, k, starts[k], counts[k]) for k in range(len(counts))]
    bodies = tuple(_body(values, poses, k, shape) for k, shape in enumerate(shapes))
    ratio, x, y = map(float, values.get("scene_world", (0.0, 0.0, 0.0)))
    return Scene(
        bodies, scale=float(values.get("scene_scale", 0.0)) or None, world=(ratio, x, y) if ratio > 0 else None
    )


def _numbers(counts: np.ndarray) -> np.ndarray:
    """Return (B, 3) numbers of vertices, faces and heights."""
    return np.stack([counts[:, 0], counts[:, 1], counts[:, 2] * counts[:, 3]], axis=1)


def _shape(values: Mapping[str, Any], body: int, start: np.ndarray, counts: np.ndarray) -> BodyShape:
    kind = str(values["scene_shapes"][body])
    if kind not in list(ShapeKind):
        raise SceneError(f"scene_shapes has the unknown shape {kind!r}")
    vertices, faces, rows, columns = counts.tolist()
    own = values["scene_faces"][start[1] : start[1] + faces]
    if own.size and (own.min() < 0 or own.max() >= vertices):
        raise SceneError(f"scene_faces of body {body} name vertices that it has not")
    return BodyShape(
        ShapeKind(kind),
        values["scene_sizes"][body],
        values["scene_vertices"][start[0] : start[0] + vertices],
        own,
        values["scene_heights"][start[2] : start[2] + rows * columns].reshape(rows, columns),
    )


def _body(values: Mapping[str, Any], poses: Floats, body: int, shape: BodyShape) -> RigidBody:
    own = poses[0, body] if values["scene_fixed"][body] else poses[:, body]
    mass, friction = float(values["scene_mass"][body]), float(values["scene_friction"][body])
    return RigidBody(str(values["scene_names"][body]), shape, own, mass=mass, friction=friction)
