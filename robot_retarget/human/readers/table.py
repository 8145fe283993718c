"""The table of formats of human motion, read or refused: how each is recognised, and its reader."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot_retarget.base.errors import MotionError, known
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers import (
    amc,
    bvh,
    c3d,
    deepmimic,
    gltf,
    humanml3d,
    isaac,
    landmarks,
    mvnx,
    optitrack_csv,
    positions,
    refused,
    sam3d,
    smpl,
    trc,
    vicon_csv,
    zipped,
)
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request


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


FORMATS = (
    MotionFormat("BVH", (".bvh",), bvh.matches_format, bvh.read),
    MotionFormat("ASF/AMC", (".amc",), amc.matches_format, amc.read, beside=amc.beside),
    MotionFormat("C3D", (".c3d",), c3d.matches_format, c3d.read, frozenset({"clip"})),
    MotionFormat("glTF, GLB, VRMA", (".glb", ".gltf", ".vrma"), gltf.matches_format, gltf.read, frozenset({"clip"})),
    MotionFormat("MVNX", (".mvnx",), mvnx.matches_format, mvnx.read, frozenset({"clip"})),
    MotionFormat("TRC", (".trc",), trc.matches_format, trc.read, frozenset({"clip"})),
    MotionFormat("CSV of OptiTrack", (), optitrack_csv.matches_format, optitrack_csv.read, frozenset({"clip"})),
    MotionFormat("CSV of Vicon", (), vicon_csv.matches_format, vicon_csv.read, frozenset({"clip"})),
    MotionFormat("DeepMimic", (), deepmimic.matches_format, deepmimic.read),
    MotionFormat("HumanML3D features", (), humanml3d.matches_format, humanml3d.read),
    MotionFormat("MediaPipe or FreeMoCap landmarks", (".csv", ".json"), landmarks.matches_format, landmarks.read),
    MotionFormat("Isaac Capture", (".mcap",), isaac.matches_format, isaac.read),
    MotionFormat("SAM 3D Body", (), sam3d.matches_format, sam3d.read, frozenset({"clip"})),
    MotionFormat("Motion-X", (), smpl.motion_x.matches_format, smpl.motion_x.read, frozenset({"body_model"})),
    MotionFormat("SMPL parameters", (), smpl.matches_format, smpl.read, frozenset({"body_model"})),
    MotionFormat(
        "SMPL parameters in a pickle",
        (".pkl", ".pickle", ".pt", ".pth", ".joblib"),
        smpl.pickled.matches_format,
        smpl.pickled.read,
        frozenset({"body_model", "clip"}),
    ),
    MotionFormat("joint positions", (".npy", ".npz"), positions.matches_format, positions.read, frozenset({"names"})),
    MotionFormat("zip of motions", (".zip",), zipped.matches_format, zipped.read, frozenset({"clip"})),
)
"""In the order of the test; the first format that matches a file reads it."""
REFUSED = tuple(MotionFormat(one.name, one.suffixes, one.matches_format, one.read) for one in refused.REFUSALS)
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
