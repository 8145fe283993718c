"""A scene as MJCF text: fixed bodies as static ones, moving bodies as mocap bodies, shapes within the text."""

from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from robot_retarget.scene.geoms import BASE, PREFIX
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import ShapeKind

TYPES = {ShapeKind.HEIGHT_FIELD: "hfield"}
"""Names of shapes in MJCF that differ from ours."""


def mjcf_text(scene: Scene) -> str:
    """Return the elements `asset` and `worldbody` of a scene; moving bodies come in its order."""
    asset, world = Element("asset"), Element("worldbody")
    for body in scene.bodies:
        pose = np.atleast_2d(body.poses)[0]
        mocap = {} if body.fixed else {"mocap": "true"}
        own = SubElement(
            world, "body", {"name": PREFIX + body.name, "pos": _row(pose[:3]), "quat": _row(pose[3:]), **mocap}
        )
        kind = TYPES.get(body.shape.kind, str(body.shape.kind))
        facts = {
            "name": PREFIX + body.name,
            "type": kind,
            "friction": f"{body.friction:g}",
            "mass": f"{body.weight:.9g}",
            **_shape(asset, body),
        }
        SubElement(own, "geom", facts)
    for element in (asset, world):
        indent(element)
    return "".join(tostring(element, encoding="unicode") + "\n" for element in (asset, world) if len(element))


def _shape(asset: Element, body: RigidBody) -> dict[str, str]:
    """Return the attributes of a body's geom; add its mesh or height field to the assets."""
    shape, name = body.shape, PREFIX + body.name
    length, width, height = shape.size.tolist()
    match shape.kind:
        case ShapeKind.MESH:
            vertices, faces = _row(shape.vertices), " ".join(map(str, shape.faces.ravel().tolist()))
            SubElement(asset, "mesh", name=name, vertex=vertices, face=faces, inertia="convex")
            return {"mesh": name}
        case ShapeKind.HEIGHT_FIELD:
            rows, columns = map(str, shape.heights.shape)
            size = _row(np.array([length / 2, width / 2, max(height, BASE), BASE]))
            # the text has the highest row first
            SubElement(
                asset, "hfield", name=name, nrow=rows, ncol=columns, size=size, elevation=_row(shape.heights[::-1])
            )
            return {"hfield": name}
        case ShapeKind.CYLINDER:
            return {"size": _row(np.array([length / 2, height / 2]))}
        case ShapeKind.PLANE:
            return {"size": "0 0 0.05"}
        case ShapeKind.SPHERE:
            return {"size": _row(np.array([length / 2]))}
        case _:
            return {"size": _row(shape.size / 2)}


def _row(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.ravel().tolist())
