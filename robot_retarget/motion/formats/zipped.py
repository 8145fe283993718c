"""BVH files in a zip, read without unpacking it: one member, and no more of it than a limit."""

from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

from robot_retarget.errors import MotionError
from robot_retarget.motion.capture import Capture
from robot_retarget.motion.formats.bvh.parse import captured
from robot_retarget.motion.formats.file_header import FileHeader
from robot_retarget.motion.formats.request import Request
from robot_retarget.unpack import BROKEN

LARGEST = 256 * 2**20
"""Of a member once it is unpacked; an hour of a body with fingers at 60 frames a second is 200 MB of BVH [bytes]."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file is a zip that holds BVH."""
    return any(_is_bvh(name) for name in header.members)


def read(path: Path, request: Request) -> Capture:
    """Read one BVH file of a zip.

    Raises:
        MotionError: no zip, no BVH in it, a member that is broken, locked, or larger than `LARGEST` once it is unpacked.
    """
    try:
        with ZipFile(path) as archive:
            inside = sorted(name for name in archive.namelist() if _is_bvh(name))
            if not inside:
                raise MotionError("holds no .bvh", path)
            titles = [Path(name).name for name in inside]
            which, notes = request.choose(titles if len(set(titles)) == len(titles) else inside, path)
            with archive.open(inside[which]) as member:
                data = member.read(LARGEST + 1)
    except BROKEN as error:
        raise MotionError(f"not a zip that can be read: {error}", path) from error
    title = f"{path}#{inside[which]}"
    if len(data) > LARGEST:
        raise MotionError(f"more than {LARGEST // 2**20} MB once it is unpacked: not read", title)
    capture = captured(data, title, request)
    return replace(capture, notes=(*notes, *capture.notes))


def _is_bvh(name: str) -> bool:
    """Whether a member is a BVH file, and no resource fork of macOS."""
    return name.lower().endswith(".bvh") and not Path(name).name.startswith(("._", "."))
