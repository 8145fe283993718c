"""Scenes as MJCF: fixed bodies are static, moving ones mocap or free bodies; and the bodies of any MJCF or URDF."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats, Ints
from robot_retarget.base.errors import SceneError
from robot_retarget.base.untrusted.models import require_bounded_model
from robot_retarget.scene.geoms import PREFIX, field_size, mesh_of, scene_geoms
from robot_retarget.scene.scene import RigidBody, Scene
from robot_retarget.scene.shape import BodyShape, ShapeKind, height_field, solid

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
            **_shape_attributes(asset, body),
        }
        SubElement(own, "geom", facts)
    return [element for element in (asset, world) if len(element)]


def _shape_attributes(asset: Element, body: RigidBody) -> dict[str, str]:
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


_GEOM, _FREE = mujoco.mjtGeom, int(mujoco.mjtJoint.mjJNT_FREE)


def read(path: Path) -> Scene:
    """Read the bodies of a model.

    Raises:
        SceneError: MuJoCo does not load it, or it holds nothing but a robot.
    """
    model = _loaded(path)
    geoms = _geoms(model)
    if not geoms.size:
        raise SceneError(f"{path}: every solid geom belongs to a robot: no body is left for a scene")
    names = [model.geom(g).name or model.body(int(model.geom_bodyid[g])).name or f"geom {g}" for g in geoms]
    unlike = [f"{name} {count}" if (count := names[: k + 1].count(name)) > 1 else name for k, name in enumerate(names)]
    poses, fps = _poses(model, geoms)
    moves = (model.body_mocapid >= 0) | (model.body_jntnum > 0)
    bodies = []
    for k, (geom, name) in enumerate(zip(geoms, unlike, strict=True)):
        own = poses[:, k] if fps and moves[model.geom_bodyid[geom]] else poses[0, k]
        bodies.append(_body(model, int(geom), name.removeprefix(PREFIX), own, fps, str(path)))
    return Scene(tuple(bodies), str(path))


def single(path: Path) -> BodyShape:
    """Return the shape of a model with one solid geom.

    Raises:
        SceneError: it has none, or several.
    """
    model = _loaded(path)
    geoms = [g for g in _geoms(model) if model.geom_type[g] != _GEOM.mjGEOM_PLANE]
    if len(geoms) != 1:
        raise SceneError(f"{path}: expected one solid geom, found {len(geoms)}: name the file as the scene instead")
    return _shape(model, int(geoms[0]), str(path))


def _loaded(path: Path) -> mujoco.MjModel:
    try:
        require_bounded_model(path)
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise SceneError(f"{path}: MuJoCo does not load it: {' '.join(str(error).split())}") from error


def _geoms(model: mujoco.MjModel) -> Ints:
    """Return the solid geoms of the world and of trees without joints other than a free one."""
    root = np.asarray(model.body_rootid)
    jointed = {int(root[model.jnt_bodyid[j]]) for j in range(model.njnt) if model.jnt_type[j] != _FREE}
    solid_geom = (model.geom_contype | model.geom_conaffinity) != 0
    still = ~np.isin(root[model.geom_bodyid], list(jointed))
    found = np.flatnonzero(solid_geom & (still | (model.geom_bodyid == 0)))
    marked = found[np.isin(found, scene_geoms(model))]
    return marked if marked.size else found


def _body(model: mujoco.MjModel, geom: int, name: str, poses: Floats, fps: float | None, source: str) -> RigidBody:
    mass = float(model.body_mass[model.geom_bodyid[geom]]) or None
    friction = float(model.geom_friction[geom, 0])
    return RigidBody(name, _shape(model, geom, source), poses, fps, mass=mass, friction=friction, source=source)


def _poses(model: mujoco.MjModel, geoms: Ints) -> tuple[Floats, float | None]:
    """Return poses (T, G, 7) of geoms at the keyframes of a motion, and their rate; (1, G, 7) and None without such keyframes."""
    data, keys = mujoco.MjData(model), [k for k in range(model.nkey) if model.key(k).name.startswith(FRAME)]
    mujoco.mj_kinematics(model, data)
    found = [[_pose(model, data, geom) for geom in geoms]] if not keys else []
    for key in keys:
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_kinematics(model, data)
        found.append([_pose(model, data, geom) for geom in geoms])
    times = model.key_time[keys]
    return np.array(found), float((len(keys) - 1) / (times[-1] - times[0])) if len(keys) > 1 else None


def _pose(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Floats:
    """Return the pose of a geom's shape: that of the body for a mesh, whose vertices are in the body's frame."""
    if model.geom_type[geom] == _GEOM.mjGEOM_MESH:
        owner = model.geom_bodyid[geom]
        return np.concatenate([data.xpos[owner], data.xquat[owner]])
    turn, matrix = np.empty(4), data.geom_xmat[geom]
    mujoco.mju_mat2Quat(turn, matrix)
    return np.concatenate([data.geom_xpos[geom] - _lift(model, geom) * matrix[2::3], turn])


def _lift(model: mujoco.MjModel, geom: int) -> float:
    """Return the height of the lowest point of a height field in its body's frame, which its heights hold; 0 of any other geom [m]."""
    field = model.geom_type[geom] == _GEOM.mjGEOM_HFIELD
    return max(0.0, float(model.geom_pos[geom, 2])) if field else 0.0


def _shape(model: mujoco.MjModel, geom: int, source: str) -> BodyShape:
    size = (2 * model.geom_size[geom]).tolist()
    match model.geom_type[geom]:
        case _GEOM.mjGEOM_BOX:
            return solid(ShapeKind.BOX, tuple(size))
        case _GEOM.mjGEOM_CYLINDER:
            return solid(ShapeKind.CYLINDER, (size[0], size[1]))
        case _GEOM.mjGEOM_SPHERE:
            return solid(ShapeKind.SPHERE, (size[0],))
        case _GEOM.mjGEOM_PLANE:
            return solid(ShapeKind.PLANE, ())
        case _GEOM.mjGEOM_MESH:
            return mesh_of(model, geom)
        case _GEOM.mjGEOM_HFIELD:
            return _field(model, int(model.geom_dataid[geom]), _lift(model, geom))
        case other:
            body, kind = model.body(model.geom_bodyid[geom]).name, mujoco.mjtGeom(other).name
            raise SceneError(f"{source}: body {body!r} has a geom of type {kind}: make it a box or a mesh")


def _field(model: mujoco.MjModel, number: int, lift: float) -> BodyShape:
    first, rows, columns = (int(v[number]) for v in (model.hfield_adr, model.hfield_nrow, model.hfield_ncol))
    length, width, top, _ = model.hfield_size[number].tolist()
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    return height_field(lift + top * heights, 2 * length, 2 * width)
