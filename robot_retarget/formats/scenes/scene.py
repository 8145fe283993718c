"""Format `mujoco-scene`: a folder that plays: the robot's own files on a floor, a keyframe a frame, and `play.py`.

`scene.xml` includes `robot.xml`, a copy of the robot's MJCF, and `keyframes.xml`, which is of the format `mujoco-keyframes`.
"""

import shutil
from dataclasses import replace
from pathlib import Path, PurePath
from xml.etree import ElementTree

import mujoco

from robot_retarget.base.errors import TrajectoryError, UsageError
from robot_retarget.formats.columns import Columns
from robot_retarget.formats.format import TrajectoryFormat
from robot_retarget.formats.robot_motion import RobotMotion
from robot_retarget.formats.scenes import keyframes
from robot_retarget.formats.scenes.keyframes import read_keys
from robot_retarget.formats.source import TrajectorySource
from robot_retarget.robot.model import Robot
from robot_retarget.scene import read_scene
from robot_retarget.scene.geoms import PREFIX
from robot_retarget.scene.mjcf_text import mjcf_text

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


def write(motion: RobotMotion, path: Path) -> None:
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
    keyframes.write(motion, path / KEYS, poses)
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


def read(source: TrajectorySource) -> Columns:
    """Read the keyframes in the folder, and the bodies of its scene."""
    keys, scene = source.path / KEYS, source.path / SCENE
    if not keys.is_file():
        raise TrajectoryError(f"no {KEYS} in the folder")
    columns = read_keys(keys.read_text(encoding="utf-8"))
    return replace(columns, scene=read_scene(scene)) if PREFIX in scene.read_text(encoding="utf-8") else columns


FORMAT = TrajectoryFormat(
    name="mujoco-scene",
    suffix="",
    description="a folder with the robot, its meshes, a floor, keyframes and a player",
    write=write,
    read=read,
    claims=lambda source: (source.path / SCENE).is_file() and (source.path / KEYS).is_file(),
    readers="MuJoCo (python play.py)",
    bodies=True,
)
