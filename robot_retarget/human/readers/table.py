"""The table of formats of human motion, read or refused: how each is recognised, and its reader."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from robot_retarget.base.errors import MotionError, known
from robot_retarget.base.untrusted.limits import member_bytes, opened_zip
from robot_retarget.human.capture import Capture, FileHeader, Request
from robot_retarget.human.readers import (
    amc,
    bvh,
    c3d,
    datasets,
    gltf,
    headset,
    landmarks,
    marker_tables,
    mvnx,
    positions,
    smpl,
    tracked_people,
)


@dataclass(frozen=True)
class MotionFormat:
    """A format of motion files."""

    name: str
    suffixes: tuple[str, ...]
    """Endings of the file name; they decide if no content matches."""
    matches_format: Callable[[FileHeader], bool]
    """Whether a file is one of it, by its content."""
    read: Callable[[Path, Request], Capture]
    takes: frozenset[str] = frozenset()
    """Fields of a request that the reader uses in addition to `fps`."""
    beside: Callable[[Path], tuple[Path, ...]] = lambda path: ()
    """Other files that the reader opens."""


def is_zip_of_bvh(header: FileHeader) -> bool:
    """Whether a file is a zip that holds BVH."""
    return any(_is_bvh(name) for name in header.members)


def read_zip(path: Path, request: Request) -> Capture:
    """Read one BVH file of a zip.

    Raises:
        MotionError: no BVH in it.
        FileError: no zip, or a member that is broken, locked, or larger than its limit once it is unpacked.
    """
    with opened_zip(path) as archive:
        inside = sorted(name for name in archive.namelist() if _is_bvh(name))
        if not inside:
            raise MotionError("holds no .bvh", path)
        titles = [Path(name).name for name in inside]
        which, notes = request.choose(titles if len(set(titles)) == len(titles) else inside, path)
        data = member_bytes(archive, inside[which], path)
    capture = bvh.captured(data, f"{path}#{inside[which]}", request)
    return replace(capture, notes=(*notes, *capture.notes))


def _is_bvh(name: str) -> bool:
    """Whether a member is a BVH file, and no resource fork of macOS."""
    return name.lower().endswith(".bvh") and not Path(name).name.startswith(("._", "."))


FORMATS = (
    MotionFormat("BVH", (".bvh",), bvh.matches_format, bvh.read_bvh),
    MotionFormat("ASF/AMC", (".amc",), amc.matches_format, amc.read, beside=amc.beside),
    MotionFormat("C3D", (".c3d",), c3d.matches_format, c3d.read, frozenset({"clip"})),
    MotionFormat("glTF, GLB, VRMA", (".glb", ".gltf", ".vrma"), gltf.matches_format, gltf.read, frozenset({"clip"})),
    MotionFormat("MVNX", (".mvnx",), mvnx.matches_format, mvnx.read, frozenset({"clip"})),
    MotionFormat("TRC", (".trc",), marker_tables.is_trc, marker_tables.read_trc, frozenset({"clip"})),
    MotionFormat("CSV of OptiTrack", (), marker_tables.is_motive, marker_tables.read_motive, frozenset({"clip"})),
    MotionFormat("CSV of Vicon", (), marker_tables.is_vicon, marker_tables.read_vicon, frozenset({"clip"})),
    MotionFormat("DeepMimic", (), datasets.is_deepmimic, datasets.read_deepmimic),
    MotionFormat("HumanML3D features", (), datasets.is_humanml3d, datasets.read_humanml3d),
    MotionFormat(
        "EasyMocap",
        (),
        tracked_people.is_easymocap,
        tracked_people.read_easymocap,
        frozenset({"clip", "body_model"}),
        tracked_people.frames_beside,
    ),
    MotionFormat("MediaPipe or FreeMoCap landmarks", (".csv", ".json"), landmarks.matches_format, landmarks.read),
    MotionFormat("Isaac Capture", (".mcap",), headset.matches_format, headset.read),
    MotionFormat("SAM 3D Body", (), tracked_people.is_sam3d, tracked_people.read_sam3d, frozenset({"clip"})),
    MotionFormat("Motion-X or PHUMA", (), datasets.is_smplx_rows, datasets.read_smplx_rows, frozenset({"body_model"})),
    MotionFormat("SMPL parameters", (), smpl.matches_format, smpl.read, frozenset({"body_model", "clip"})),
    MotionFormat(
        "SMPL parameters in a pickle",
        (".pkl", ".pickle", ".pt", ".pth", ".joblib", ".pk"),
        tracked_people.is_pickle,
        tracked_people.read_pickle,
        frozenset({"body_model", "clip"}),
        tracked_people.camera_beside,
    ),
    MotionFormat("joint positions", (".npy", ".npz"), positions.matches_format, positions.read, frozenset({"names"})),
    MotionFormat("zip of motions", (".zip",), is_zip_of_bvh, read_zip, frozenset({"clip"})),
)
"""In the order of the test; the first format that matches a file reads it."""


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


def _refused(
    name: str, suffixes: tuple[str, ...], matches_format: Callable[[FileHeader], bool], sentence: str
) -> MotionFormat:
    """Return a known format that is not read; `{path}` in the sentence is the file, `{stem}` its name without the ending."""

    def read(path: Path, request: Request) -> NoReturn:
        raise MotionError(sentence.format(path=path, stem=path.stem), path)

    return MotionFormat(name, suffixes, matches_format, read)


REFUSED = (
    _refused(
        "ASF skeleton",
        (".asf",),
        lambda header: ":bonedata" in header.text.lower(),
        "is a skeleton without a motion: give the .amc, and leave this file next to it",
    ),
    _refused(
        "FBX",
        (".fbx",),
        lambda header: header.head.startswith(b"Kaydara FBX") or header.text.lstrip().startswith("; FBX"),
        f"FBX is not read. Convert it, and give {{stem}}.glb: {_blender('bpy.ops.import_scene.fbx')}",
    ),
    _refused(
        "USD",
        (".usd", ".usda", ".usdc", ".usdz"),
        _is_usd,
        f"USD is not read. Convert it, and give {{stem}}.glb: {_blender('bpy.ops.wm.usd_import')}",
    ),
    _refused(
        "VMD",
        (".vmd",),
        lambda header: header.head.startswith(b"Vocaloid Motion Data"),
        "VMD holds turns of bones and goals of feet of an MMD model, which the file does not contain, and is not read. "
        "Open both in Blender with mmd_tools, bake the motion, and export {stem}.glb or {stem}.bvh",
    ),
    _refused(
        "OpenSim MOT or STO",
        (".mot", ".sto"),
        _is_mot,
        "MOT and STO hold joint angles of an OpenSim model, which the file does not contain, and are not read. Compute "
        "the joint centres (OpenSim: Analyze, PointKinematics) and save them as .npz with positions (T, J, 3) [m], "
        "names, parents and fps; or give the C3D file they came from",
    ),
)
"""Known, and refused with what to do instead."""


def format_of(path: Path) -> MotionFormat:
    """The format of a file, by its content; by its suffix where the content says nothing.

    Raises:
        MotionError: no format matches; lists the known ones.
    """
    header = FileHeader(path)
    suffix = path.suffix.lower()
    every = (*FORMATS, *REFUSED)
    found = next((one for one in every if one.matches_format(header)), None)
    found = found or next((one for one in every if suffix in one.suffixes), None)
    if found is None:
        listed = (f"{one.name} ({', '.join(one.suffixes)})" if one.suffixes else one.name for one in FORMATS)
        raise MotionError(f"unknown kind of motion file {suffix!r}; {known(listed)}", path)
    return found
