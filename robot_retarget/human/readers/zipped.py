"""BVH files in a zip, read without unpacking it: one member, and no more of it than a limit."""

from dataclasses import replace
from pathlib import Path

from robot_retarget.base.errors import MotionError
from robot_retarget.base.untrusted.limits import member_bytes, opened_zip
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.bvh.parse import captured
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request


def matches_format(header: FileHeader) -> bool:
    """Whether a file is a zip that holds BVH."""
    return any(_is_bvh(name) for name in header.members)


def read(path: Path, request: Request) -> Capture:
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
    capture = captured(data, f"{path}#{inside[which]}", request)
    return replace(capture, notes=(*notes, *capture.notes))


def _is_bvh(name: str) -> bool:
    """Whether a member is a BVH file, and no resource fork of macOS."""
    return name.lower().endswith(".bvh") and not Path(name).name.startswith(("._", "."))
