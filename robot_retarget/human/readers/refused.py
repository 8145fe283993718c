"""Known formats of motion that are not read, each with a sentence about its conversion."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from robot_retarget.base.errors import MotionError
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request


@dataclass(frozen=True)
class Refusal:
    """A format, its marks, and the sentence about it."""

    name: str
    suffixes: tuple[str, ...]
    matches_format: Callable[[FileHeader], bool]
    sentence: str
    """`{path}` is the file, `{stem}` its name without the ending."""

    def read(self, path: Path, request: Request) -> NoReturn:
        """Raise MotionError with the sentence."""
        raise MotionError(self.sentence.format(path=path, stem=path.stem), path)


def _blender(step: str) -> str:
    """The command by which Blender, here a Python package, imports a file and saves it as GLB."""
    empty = "bpy.ops.wm.read_factory_settings(use_empty=True)"
    save = "bpy.ops.export_scene.gltf(filepath='{stem}.glb')"
    return f"pip install bpy, and python -c \"import bpy; {empty}; {step}(filepath='{{path}}'); {save}\""


def _is_mot(header: FileHeader) -> bool:
    """Whether a text has the header of OpenSim's storage files."""
    return "endheader" in header.text.lower() and "indegrees" in header.text.lower()


def _is_usd(header: FileHeader) -> bool:
    in_zip = any(name.endswith((".usd", ".usda", ".usdc")) for name in header.members)
    return in_zip or header.head.startswith((b"PXR-USDC", b"#usda"))


REFUSALS = (
    Refusal(
        "ASF skeleton",
        (".asf",),
        lambda header: ":bonedata" in header.text.lower(),
        "is a skeleton without a motion: give the .amc, and leave this file next to it",
    ),
    Refusal(
        "FBX",
        (".fbx",),
        lambda header: header.head.startswith(b"Kaydara FBX") or header.text.lstrip().startswith("; FBX"),
        f"FBX is not read. Convert it, and give {{stem}}.glb: {_blender('bpy.ops.import_scene.fbx')}",
    ),
    Refusal(
        "USD",
        (".usd", ".usda", ".usdc", ".usdz"),
        _is_usd,
        f"USD is not read. Convert it, and give {{stem}}.glb: {_blender('bpy.ops.wm.usd_import')}",
    ),
    Refusal(
        "VMD",
        (".vmd",),
        lambda header: header.head.startswith(b"Vocaloid Motion Data"),
        "VMD holds turns of bones and goals of feet of an MMD model, which the file does not contain, and is not read. "
        "Open both in Blender with mmd_tools, bake the motion, and export {stem}.glb or {stem}.bvh",
    ),
    Refusal(
        "OpenSim MOT or STO",
        (".mot", ".sto"),
        _is_mot,
        "MOT and STO hold joint angles of an OpenSim model, which the file does not contain, and are not read. Compute "
        "the joint centres (OpenSim: Analyze, PointKinematics) and save them as .npz with positions (T, J, 3) [m], "
        "names, parents and fps; or give the C3D file they came from",
    ),
)
