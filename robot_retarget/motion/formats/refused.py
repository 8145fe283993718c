"""Files that are known and not read, each with the line that makes one of them that is."""

from pathlib import Path
from typing import NoReturn

from robot_retarget.errors import MotionError
from robot_retarget.motion.formats.glimpse import Glimpse
from robot_retarget.motion.formats.request import Request


def asf(glimpse: Glimpse) -> bool:
    """Whether a file is the skeleton of AMC motions."""
    return ":bonedata" in glimpse.text.lower()


def skeleton_alone(path: Path, request: Request) -> NoReturn:
    """Refuse a skeleton without a motion."""
    raise MotionError("is a skeleton without a motion: give the .amc, and leave this file beside it", path)


def fbx(glimpse: Glimpse) -> bool:
    """Whether a file is FBX, binary or text."""
    return glimpse.head.startswith(b"Kaydara FBX") or glimpse.text.lstrip().startswith("; FBX")


def convert_fbx(path: Path, request: Request) -> NoReturn:
    """Refuse FBX, with how Blender makes a GLB of it."""
    empty = "bpy.ops.wm.read_factory_settings(use_empty=True)"
    steps = f"import bpy; {empty}; bpy.ops.import_scene.fbx(filepath='{path}'); bpy.ops.export_scene.gltf(filepath='{path.stem}.glb')"
    raise MotionError(
        f'FBX is not read. Convert it, and give {path.stem}.glb: blender --background --python-expr "{steps}"',
        path,
    )
