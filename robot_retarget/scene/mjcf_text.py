"""A scene as MJCF text: fixed bodies as static ones, moving bodies as mocap or free bodies, shapes within the text."""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from robot_retarget.scene.geoms import PREFIX, field_size
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind

TYPES = {ShapeKind.HEIGHT_FIELD: "hfield"}
"""Names of shapes in MJCF that differ from ours."""


FRAME = "frame_"
"""Keyframes of a motion have this before the number of their frame."""


def mjcf_file(scene: Scene, frames: int, fps: float) -> str:
    """Return an MJCF file of a scene over T frames: moving bodies are free, and a keyframe has their poses at each frame."""
    top = Element("mujoco", model="scene")
    top.extend(_elements(scene, free=True))
    moving = [k for k, body in enumerate(scene.bodies) if not body.fixed]
    if moving:
        keys = SubElement(top, "keyframe")
        for frame, poses in enumerate(scene.poses(frames)[:, moving]):
            SubElement(keys, "key", name=f"{FRAME}{frame}", time=f"{frame / fps:.17g}", qpos=_row(poses))
    indent(top)
    return tostring(top, encoding="unicode") + "\n"


def mjcf_text(scene: Scene) -> str:
    """Return the elements `asset` and `worldbody` of a scene; moving bodies are mocap bodies, in its order."""
    elements = _elements(scene, free=False)
    for element in elements:
        indent(element)
    return "".join(tostring(element, encoding="unicode") + "\n" for element in elements)


def _elements(scene: Scene, free: bool) -> list[Element]:
    """Return the elements `asset` and `worldbody` that are not empty."""
    asset, world = Element("asset"), Element("worldbody")
    for body in scene.bodies:
        pose, name = np.atleast_2d(body.poses)[0], PREFIX + body.name
        mocap = {"mocap": "true"} if not (body.fixed or free) else {}
        own = SubElement(world, "body", {"name": name, "pos": _row(pose[:3]), "quat": _row(pose[3:]), **mocap})
        if free and not body.fixed:
            SubElement(own, "freejoint", name=name)
        facts = {
            "name": name,
            "type": TYPES.get(body.shape.kind, str(body.shape.kind)),
            "friction": f"{body.friction:g}",
            "mass": f"{body.weight:.9g}",
            **_shape(asset, body),
        }
        SubElement(own, "geom", facts)
    return [element for element in (asset, world) if len(element)]


def _shape(asset: Element, body: RigidBody) -> dict[str, str]:
    """Return the attributes of a body's geom; add its mesh or height field to the assets."""
    shape, name = body.shape, PREFIX + body.name
    length, _, height = shape.size.tolist()
    match shape.kind:
        case ShapeKind.MESH:
            vertices, faces = _row(shape.vertices), " ".join(map(str, shape.faces.ravel().tolist()))
            SubElement(asset, "mesh", name=name, vertex=vertices, face=faces, inertia="convex")
            return {"mesh": name}
        case ShapeKind.HEIGHT_FIELD:
            (rows, columns), (low, size) = map(str, shape.heights.shape), field_size(shape)
            elevation = _row(shape.heights[::-1] - low)  # the text has the highest row first
            facts = {"name": name, "nrow": rows, "ncol": columns, "size": _row(np.array(size)), "elevation": elevation}
            SubElement(asset, "hfield", facts)
            return {"hfield": name, "pos": _row(np.array([0, 0, low]))}
        case ShapeKind.CYLINDER:
            return {"size": _row(np.array([length / 2, height / 2]))}
        case ShapeKind.PLANE:
            return {"size": "0 0 0.05"}
        case ShapeKind.SPHERE:
            return {"size": _row(np.array([length / 2]))}
        case _:
            return {"size": _row(shape.size / 2)}


def _row(values: np.ndarray) -> str:
    return " ".join(f"{value:.17g}" for value in values.ravel().tolist())
