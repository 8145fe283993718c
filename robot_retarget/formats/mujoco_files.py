"""MuJoCo's own files: `mujoco-keyframes`, a file to include, and `mujoco-scene`, a folder that plays."""

import shutil
from dataclasses import replace
from pathlib import Path, PurePath
from xml.etree import ElementTree

import mujoco
import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.source import TrajectorySource, declared
from robot_retarget.formats.tables import rate
from robot_retarget.robot.model import Robot
from robot_retarget.scene import read_scene
from robot_retarget.scene.geoms import PREFIX
from robot_retarget.scene.mjcf import mjcf_text

# Format `mujoco-keyframes`: an MJCF file of keyframes, a frame each, to be included in the robot's.
#
# `<key name time qpos/>`, qpos in MuJoCo's order, root w x y z. `<include file="keys.xml"/>` in the robot's MJCF makes the
# frames the keyframes of `simulate` and of `mj_resetDataKeyframe`.

EXACT = "%.17g"


def write_keyframes(motion: RobotMotion, path: Path, bodies: Floats | None = None) -> None:
    """Write the keyframes.

    Args:
        bodies: (T, M, 7) poses of mocap bodies, for a model that has them.
    """
    top = ElementTree.Element("mujoco", model=motion.robot.name)
    keys = ElementTree.SubElement(top, "keyframe")
    for frame, qpos in enumerate(motion.qpos):
        mocap = {} if bodies is None else {"mpos": _row(bodies[frame, :, :3]), "mquat": _row(bodies[frame, :, 3:])}
        time = EXACT % (frame / motion.fps)
        ElementTree.SubElement(keys, "key", {"name": f"frame_{frame}", "time": time, "qpos": _row(qpos), **mocap})
    ElementTree.indent(top)
    path.write_text(ElementTree.tostring(top, encoding="unicode") + "\n", encoding="utf-8")


def _row(values: Floats) -> str:
    return " ".join(EXACT % value for value in values.ravel())


def read_keyframes(source: TrajectorySource) -> Columns:
    """Read the keyframes."""
    return read_keys(source.text)


def read_keys(text: str) -> Columns:
    """The keyframes of an MJCF text in the order of their times.

    Raises:
        TrajectoryError: not XML, no keyframes with qpos, or of several widths.
    """
    try:
        keys = [key for key in ElementTree.fromstring(text).iter("key") if key.get("qpos")]
        rows = [(float(key.get("time", 0)), np.array((key.get("qpos") or "").split(), dtype=float)) for key in keys]
    except (ElementTree.ParseError, ValueError) as error:
        raise TrajectoryError(f"not MJCF: {error}") from error
    if not rows:
        raise TrajectoryError("no keyframe with qpos")
    if len({len(qpos) for _, qpos in rows}) > 1:
        raise TrajectoryError("keyframes of several widths")
    rows.sort(key=lambda row: row[0])
    return Columns(qpos=np.stack([qpos for _, qpos in rows]), fps=rate(np.array([time for time, _ in rows])))


KEYFRAMES = declared(
    "mujoco-keyframes",
    write_keyframes,
    read_keyframes,
    lambda source: source.text.lstrip().startswith("<mujoco") and "<key " in source.text,
)


# Format `mujoco-scene`: a folder that plays: the robot's own files on a floor, a keyframe a frame, and `play.py`.
#
# `scene.xml` includes `robot.xml`, a copy of the robot's MJCF, and `keyframes.xml`, which is of the format `mujoco-keyframes`.

SCENE, ROBOT, KEYS = "scene.xml", "robot.xml", "keyframes.xml"
PLAYER = '''"""Play the keyframes of scene.xml: python play.py (needs mujoco)."""

import time
from pathlib import Path

import mujoco
import mujoco.viewer

model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("scene.xml")))
data = mujoco.MjData(model)
frames = [key for key in range(model.nkey) if model.key(key).name.startswith("frame_")]
with mujoco.viewer.launch_passive(model, data) as viewer:
    while viewer.is_running():
        began = time.monotonic()
        for key in frames:
            mujoco.mj_resetDataKeyframe(model, data, key)
            mujoco.mj_forward(model, data)
            viewer.sync()
            time.sleep(max(0.0, began + model.key_time[key] - time.monotonic()))
            if not viewer.is_running():
                break
'''


def write_scene_folder(motion: RobotMotion, path: Path) -> None:
    """Fill the folder.

    Raises:
        UsageError: the robot's files are not MJCF, or refer to files outside their folder.
    """
    robot = motion.robot
    for file in _files(robot):
        copy = path / file
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(robot.path.parent / file, copy)
    shutil.copyfile(robot.path, path / ROBOT)
    scene = motion.trajectory.scene
    moving = [] if scene is None else [k for k, body in enumerate(scene.bodies) if not body.fixed]
    poses = scene.poses(len(motion))[:, moving] if scene is not None and moving else None
    write_keyframes(motion, path / KEYS, poses)
    (path / SCENE).write_text(_scene(robot, "" if scene is None else mjcf_text(scene)), encoding="utf-8")
    (path / "play.py").write_text(PLAYER, encoding="utf-8")


def _scene(robot: Robot, bodies: str) -> str:
    """The MJCF text: robot, keyframes, bodies of a scene, and a floor and a light where the robot's file has none."""
    floor = (
        "" if (robot.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).any() else '<geom type="plane" size="0 0 .05"/>'
    )
    light = "" if robot.model.nlight else '<light pos="0 0 3" dir="0 0 -1"/>'
    return (
        f'<mujoco model="{robot.name}">\n  <include file="{ROBOT}"/>\n  <include file="{KEYS}"/>\n'
        f"  <worldbody>{light}{floor}</worldbody>\n{bodies}</mujoco>\n"
    )


def _files(robot: Robot) -> set[PurePath]:
    """Files to which the robot's MJCF refers, relative to its folder: included files, meshes, textures, height fields."""
    try:
        spec = mujoco.MjSpec.from_file(str(robot.path))
        if spec.compile().nq != robot.model.nq:
            raise UsageError(f"{robot.path} does not hold the model that moves: save it as MJCF first")
        found = {PurePath(element.get("file", "")) for element in ElementTree.parse(robot.path).iter("include")}
    except (ValueError, ElementTree.ParseError) as error:
        raise UsageError(f"MuJoCo does not load {robot.path}: {error}") from error
    for things, where in ((spec.meshes, spec.meshdir), (spec.textures, spec.texturedir), (spec.hfields, spec.meshdir)):
        found |= {PurePath(where) / thing.file for thing in things if thing.file}
    outside = [file for file in found if file.is_absolute() or ".." in file.parts]
    if outside:
        raise UsageError(f"{robot.path} refers to {outside[0]}, outside its folder: a scene would not hold it")
    return found


def read_scene_folder(source: TrajectorySource) -> Columns:
    """Read the keyframes in the folder, and the bodies of its scene."""
    keys, scene = source.path / KEYS, source.path / SCENE
    if not keys.is_file():
        raise TrajectoryError(f"no {KEYS} in the folder")
    columns = read_keys(keys.read_text(encoding="utf-8"))
    return replace(columns, scene=read_scene(scene)) if PREFIX in scene.read_text(encoding="utf-8") else columns


SCENE_FOLDER = declared(
    "mujoco-scene",
    write_scene_folder,
    read_scene_folder,
    lambda source: (source.path / SCENE).is_file() and (source.path / KEYS).is_file(),
)
