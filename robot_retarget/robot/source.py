"""Read a robot's file to a specification, and compile it or load its model from the cache."""

import hashlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from robot_retarget.base.cache import cache_folder, drop_oldest, is_sound, keeping, private_cache
from robot_retarget.base.errors import OutputError, RobotError
from robot_retarget.base.untrusted.limits import one_line
from robot_retarget.base.untrusted.models import documents, require_bounded_model

# Read a robot's file to a specification: MJCF directly, URDF by MuJoCo's reader; add a missing free joint.

Quaternion = tuple[float, float, float, float]
"""w x y z."""
URDF_READER = {
    "strippath": "false",  # keep whole mesh paths
    "fusestatic": "false",  # links on fixed joints stay bodies
    "discardvisual": "false",
    "balanceinertia": "true",  # exporters round
    "boundmass": "1e-6",
    "boundinertia": "1e-9",
}
"""Options of MuJoCo's URDF reader."""
URDF_NUMBERS: dict[str, tuple[str, ...]] = {
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}
"""Elements of a URDF with their attributes that are numbers."""
MESHES = (".stl", ".obj", ".msh")
"""Mesh formats that MuJoCo reads."""
SHAPES = ("visual", "collision")
MOMENTS: tuple[str, ...] = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
"""Attributes of a URDF's inertia, as the rows of its matrix."""
HINGES = ("revolute", "continuous")
UP = 5
"""Number of folders above the URDF's in which meshes of a package are searched."""
FREE_JOINT = "free_root"


def read_spec(path: Path, freed: Quaternion | None = None) -> mujoco.MjSpec:
    """Return the specification of a model.

    Args:
        path: path of an MJCF or a URDF.
        freed: rotation of the robot; the robot also gets a free joint if the file has none (`set_free`).

    Raises:
        RobotError: the file is no model; the message gives the place and the reason.
    """
    try:
        require_bounded_model(path, Path(__file__))
        spec = parsed(path)
        if freed is not None:
            set_free(spec, freed)
    except (ValueError, OSError, ET.ParseError, RecursionError) as error:
        raise RobotError(f"{path}: MuJoCo does not load it: {' '.join(str(error).split())}") from error
    return spec


def parsed(path: Path) -> mujoco.MjSpec:
    """Return the specification of a model as the file has it, without the parts that are omitted.

    Raises:
        ValueError: MuJoCo refuses the file.
        OSError: it cannot be read.
        ParseError: a URDF is no XML.
    """
    spec = urdf_spec(path) if is_urdf(path) else mjcf_spec(path)
    for part in (*rods(spec), *scene_pairs(spec)):
        spec.delete(part)
    _join_root(spec)
    return spec


def _join_root(spec: mujoco.MjSpec) -> None:
    """Replace slides along x, y, z and a ball joint of a body in the world by the free joint that they amount to."""
    ball, slide = mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_SLIDE
    for body in spec.worldbody.bodies:
        types, ways = [joint.type for joint in body.joints], [joint.axis for joint in body.joints]
        if types == [slide, slide, slide, ball] and np.allclose(ways[:3], np.eye(3)):
            for joint in list(body.joints):
                spec.delete(joint)
            for key in spec.keys:  # slides count from the body's place
                key.qpos = np.concatenate([np.add(key.qpos[:3], body.pos), key.qpos[3:]])
            body.add_freejoint(name=FREE_JOINT)


def rods(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    """Return bodies on ball joints that carry no other joint, or passive ones up to the end of a loop: rods of closed chains."""
    ball, found, driven = mujoco.mjtJoint.mjJNT_BALL, [], {motor.target for motor in spec.actuators}
    for joint in spec.joints:
        body, own = joint.parent, joint.parent.find_all("joint")
        passive = not driven & {other.name for other in own} and _loops(spec, body)
        if joint.type == ball and (passive or all(other.type == ball for other in own)):
            found.append(body)
    inside = {child.id for rod in found for child in rod.find_all("body")}
    return [rod for rod in found if rod.id not in inside]


def _loops(spec: mujoco.MjSpec, rod: mujoco.MjsBody) -> list[str]:
    """Return the bodies that equality constraints join to a rod or to its children."""
    own, joined = {rod.name} | {body.name for body in rod.find_all("body")}, []
    for equality in spec.equalities:
        ends = [equality.name1, equality.name2 or "world"]
        if equality.objtype == mujoco.mjtObj.mjOBJ_SITE:
            ends = [spec.site(end).parent.name for end in ends]
        if equality.type in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD) and own & set(ends):
            joined += [end for end in ends if end not in own]
    return joined


def scene_pairs(spec: mujoco.MjSpec) -> list[mujoco.MjsPair]:
    """Return contact pairs of which a geom is in another file, such as the floor of the scene."""
    geoms = {geom.name for geom in spec.geoms}
    return [pair for pair in spec.pairs if not {pair.geomname1, pair.geomname2} <= geoms]


def omission_notes(path: Path) -> tuple[str, ...]:
    """Describe the parts of a model file that are omitted or replaced."""
    if is_urdf(path):
        tree = ET.parse(path).getroot()
        folder = _compiler(tree).attrib.get("meshdir", "")
        omitted = {
            f"meshes not found, or none that MuJoCo reads ({', '.join(MESHES)})": [
                f"{link.get('name')} ({kind})"
                for link, kind, _, mesh in _mesh_shapes(tree)
                if mesh_file(path, folder, mesh.get("filename", "")) is None
            ],
            "moments of inertia that no body has, replaced by their mean about every axis": [
                link.get("name", "") for link, *_ in _impossible(tree)
            ],
        }
    else:
        spec = mjcf_spec(path)
        omitted = {
            "rods on ball joints left out, with the loops they close": [
                " to ".join([rod.name, *dict.fromkeys(_loops(spec, rod))]) for rod in rods(spec)
            ],
            "contact pairs left out, with a geom that the file lacks": [pair.name for pair in scene_pairs(spec)],
        }
    return tuple(f"{what}: {_some(names)}" for what, names in omitted.items() if names)


def _some(names: list[str]) -> str:
    """Return the first names of a list, and the number of the rest."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def is_urdf(path: Path) -> bool:
    """Whether a model file is a URDF, by its first element."""
    if path.suffix.lower() == ".urdf":
        return True
    try:
        return next((element.tag for _, element in ET.iterparse(path, ("start",))), "") == "robot"
    except (ET.ParseError, OSError):
        return False


def mjcf_spec(path: Path) -> mujoco.MjSpec:
    """Read an MJCF by its content; MuJoCo's reader of files knows the ending `.xml` alone."""
    if path.suffix.lower() == ".xml":
        return mujoco.MjSpec.from_file(str(path))
    parts = {str(file.relative_to(path.parent)): file.read_bytes() for file in list(documents(path))[1:]}
    spec = mujoco.MjSpec.from_string(path.read_text(encoding="utf-8"), include=parts)
    spec.modelfiledir = str(path.parent)  # pyright: ignore[reportAttributeAccessIssue]
    return spec


def urdf_spec(path: Path) -> mujoco.MjSpec:
    """Read a URDF with MuJoCo's reader; find its meshes, omit those that are absent or not readable, and round impossible inertias."""
    tree = ET.parse(path).getroot()
    _require_numbers(tree, path)
    for _, inertia, mean in _impossible(tree):
        inertia.attrib.update(dict.fromkeys(MOMENTS, "0") | dict.fromkeys(MOMENTS[::4], str(mean)))
    folder = _compiler(tree).attrib.pop("meshdir", "")
    _compiler(tree).attrib.update(URDF_READER)
    for link, _, shape, mesh in _mesh_shapes(tree):
        found = mesh_file(path, folder, mesh.get("filename", ""))
        if found is None:
            link.remove(shape)
        else:
            mesh.set("filename", str(found))
    return mujoco.MjSpec.from_string(ET.tostring(tree, encoding="unicode"))


def urdf_speeds(path: Path) -> dict[str, float]:
    """Return the joints' speed limits in a URDF, which MuJoCo does not store [rad/s]."""
    hinges = [j for j in ET.parse(path).getroot().iter("joint") if j.get("type") in HINGES]
    joints = {joint.get("name", ""): joint.find("limit") for joint in hinges}
    speeds = {name: float(limit.get("velocity", 0)) for name, limit in joints.items() if limit is not None}
    return {name: speed for name, speed in speeds.items() if speed > 0}


def mesh_file(urdf: Path, folder: str, name: str) -> Path | None:
    """Return the file for a name in a URDF; `package://…` is searched in the folders above the URDF's.

    A mesh in an unsupported format is replaced by a file of the same name in a supported format next to it.

    Args:
        urdf: path of the URDF.
        folder: its mesh folder, relative to the URDF.
        name: name of the mesh in the URDF.
    """
    bare = name.partition("://")[2] or name
    parts = Path(bare).parts
    places = [urdf.parent / bare, urdf.parent / folder / bare, urdf.parent / folder / parts[-1]] if parts else []
    places += [up / Path(*parts[k:]) for k in range(len(parts)) for up in [urdf.parent, *urdf.parents[1:UP]]]
    for place in places:
        for candidate in (place, *(place.with_suffix(s) for kind in MESHES for s in (kind, kind.upper()))):
            if candidate.suffix.lower() in MESHES and candidate.is_file():
                return candidate.resolve()
    return None


def set_free(spec: mujoco.MjSpec, turn: Quaternion) -> None:
    """Turn the first body of the world that carries a joint, and give it a free joint if it is fixed to the world.

    Keyframes start at its pose; keyframes of a body that is free already include its rotation.

    Args:
        spec: the specification, which changes.
        turn: rotation w x y z.
    """
    from scipy.spatial.transform import Rotation  # takes longer to load than a model in another process to compile

    model = spec.compile()
    first, address = int(model.body_rootid[model.jnt_bodyid[0]]), int(model.jnt_qposadr[0])
    own = Rotation.from_quat(model.body_quat[first], scalar_first=True)
    quaternion = (Rotation.from_quat(turn, scalar_first=True) * own).as_quat(scalar_first=True)
    body = spec.bodies[first]
    body.quat, body.alt.type = quaternion, mujoco.mjtOrientation.mjORIENTATION_QUAT
    if model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        return
    for key in [key for key in spec.keys if len(key.qpos)]:
        qpos = np.array(key.qpos)
        key.qpos = np.concatenate([qpos[:address], model.body_pos[first], quaternion, qpos[address:]])
    body.add_freejoint(name=FREE_JOINT)


def _require_numbers(tree: ET.Element, path: Path) -> None:
    """Require numbers in a URDF that are finite, limits of joints apart; MuJoCo takes others for 0.

    Raises:
        RobotError: one is not; names the element and the attribute.
    """
    for element, key in ((one, key) for tag, keys in URDF_NUMBERS.items() for one in tree.iter(tag) for key in keys):
        text = element.get(key, "0")
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError as error:
            raise RobotError(f"{path}: {key} of <{element.tag}> is no number: {one_line(text, 40)!r}") from error
        if any(math.isnan(n) or (math.isinf(n) and element.tag != "limit") for n in numbers):
            raise RobotError(f"{path}: {key} of <{element.tag}> is not finite: {one_line(text, 40)!r}")


def require_finite(model: mujoco.MjModel) -> None:
    """Require that a model has no NaN and no infinity, which MuJoCo reads with a warning at most.

    Raises:
        ValueError: it has; names the part and the array.
    """
    parts = {"body": model.body, "jnt": model.joint, "geom": model.geom, "site": model.site, "actuator": model.actuator}
    for name in dir(model):
        derived = name.endswith("invweight0")
        values = getattr(model, name) if name.partition("_")[0] in parts and not derived else None
        if isinstance(values, np.ndarray) and values.dtype.kind == "f" and not np.isfinite(values).all():
            kind, _, array = name.partition("_")
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            raise ValueError(f"{array} of {kind} {parts[kind](row).name!r} is not finite: {values[row]}")


def _impossible(tree: ET.Element) -> Iterator[tuple[ET.Element, ET.Element, float]]:
    """Yield the links with a negative moment of inertia, which MuJoCo refuses: the link, its inertia, the mean moment [kg m²]."""
    for link in tree.iter("link"):
        inertia = link.find("inertial/inertia")
        if inertia is not None:
            moments = np.linalg.eigvalsh(np.reshape([float(inertia.get(key, 0)) for key in MOMENTS], (3, 3)))
            if moments[0] < 0:
                yield link, inertia, float(moments.mean())


def _compiler(tree: ET.Element) -> ET.Element:
    """Return the element with MuJoCo's options in a URDF; add it if it is absent."""
    own = tree.find("mujoco")
    own = ET.SubElement(tree, "mujoco") if own is None else own
    compiler = own.find("compiler")
    return ET.SubElement(own, "compiler") if compiler is None else compiler


def _mesh_shapes(tree: ET.Element) -> Iterator[tuple[ET.Element, str, ET.Element, ET.Element]]:
    """Yield every mesh shape of a link: the link, its purpose, the shape, the mesh."""
    for link in tree.iter("link"):
        for kind in SHAPES:
            for shape in link.findall(kind):
                mesh = shape.find("geometry/mesh")
                if mesh is not None:
                    yield link, kind, shape, mesh


# Compile a specification, or load its model from the user's cache: hulls of large meshes take long to compute.

KEPT_FROM = 5e6
"""Models with smaller assets compile about as fast as they load [bytes]."""
KEPT_BYTES = 1e9
"""The kept models take no more: one of a robot with detailed meshes takes .1 of it [bytes]."""


def compiled(spec: mujoco.MjSpec, path: Path, freed: Quaternion | None = None) -> mujoco.MjModel:
    """Return the model of a specification that `read_spec` read from a file.

    Args:
        spec: the specification, unchanged since it was read.
        path: the file.
        freed: as in `read_spec`.

    Raises:
        ValueError: MuJoCo does not compile it.
    """
    kept = _place(spec, path, freed)
    try:
        if kept is not None and is_sound(kept):
            return mujoco.MjModel.from_binary_path(str(kept))
    except (OSError, ValueError):
        pass  # it is compiled again
    model = spec.compile()
    if kept is not None:
        _keep(model, kept)
    return model


def _keep(model: mujoco.MjModel, place: Path) -> None:
    """Write a model to the cache, if that is writable."""
    try:
        private_cache()
        with keeping(place) as scratch:
            mujoco.mj_saveModel(model, str(scratch))
        drop_oldest("*.mjb", KEPT_BYTES)
    except (OutputError, OSError):
        return


def _place(spec: mujoco.MjSpec, path: Path, freed: Quaternion | None) -> Path | None:
    """Return where a model is kept, by a hash of all that determines it; None for one with small or unknown files."""
    try:
        assets = _assets(spec)
        if sum(asset.stat().st_size for asset in assets) < KEPT_FROM:
            return None
        digest = hashlib.sha256(
            repr((mujoco.__version__, freed, assets)).encode()
        )  # a model holds the paths of its assets
        for file in (Path(__file__), *documents(path), *assets):
            digest.update(file.read_bytes())
    except (OSError, KeyError, ET.ParseError):
        return None
    return cache_folder() / f"{digest.hexdigest()}.mjb"


def _assets(spec: mujoco.MjSpec) -> list[Path]:
    """Return the files of meshes, textures, height fields and skins."""
    folder = Path(spec.modelfiledir)
    textures = [name for texture in spec.textures for name in (texture.file, *texture.cubefiles)]
    shapes = [asset.file for asset in (*spec.meshes, *spec.hfields, *spec.skins)]
    placed = [(spec.texturedir, name) for name in textures] + [(spec.meshdir, name) for name in shapes]
    return [folder / where / name for where, name in placed if name]
