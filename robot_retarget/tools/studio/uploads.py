"""Uploaded files: each has a new folder, into which a zip is unpacked."""

import re
import shutil
from itertools import count
from pathlib import Path, PurePosixPath
from zipfile import ZipInfo

from robot_retarget.base.errors import FileError, UsageError
from robot_retarget.base.files import folder
from robot_retarget.base.untrusted.limits import LIMITS, opened_member, opened_zip
from robot_retarget.tools.cli.options import MODELS

MEMBERS = 5000
"""Most files of a zip [-]: a humanoid with all its meshes has a few hundred."""
CHUNK = 1 << 20
"""Bytes that are copied at once."""


def plain_name(name: str) -> str:
    """Return the file name of a POSIX or Windows path; an underscore replaces characters with a meaning in a shell or a file system."""
    return re.sub(r"[^\w.+-]+", "_", re.split(r"[/\\]", name)[-1]).lstrip(".-") or "unnamed"


def place_for(studio: Path, name: str) -> Path:
    """Make a new folder with the name of a file, and with a number if that folder exists."""
    stem = PurePosixPath(name).stem
    paths = (studio / (stem if k == 1 else f"{stem}_{k}") for k in count(1))
    return folder(next(path for path in paths if not path.exists()))


def unpacked_zip(path: Path) -> Path:
    """Unpack a zip next to it and return the folder.

    Raises:
        FileError: it is no zip, is too large, or holds a name that leads out of its folder; the unpacked files are removed.
    """
    target = path.with_suffix("")
    try:
        with opened_zip(path) as archive:
            members = [member for member in archive.infolist() if not member.is_dir()]
            if len(members) > MEMBERS:
                raise FileError(f"{len(members)} files, more than {MEMBERS}")
            for member in members:
                _require_inside(member)
            left = LIMITS.unpacked(path)
            for member in members:
                inner = target / member.filename
                inner.parent.mkdir(parents=True, exist_ok=True)
                with opened_member(archive, member.filename) as content, inner.open("wb") as copy:
                    while piece := content.read(CHUNK):
                        left -= len(piece)
                        if left < 0:
                            raise FileError(f"unpacks to more than {LIMITS.unpacked(path)} bytes")
                        copy.write(piece)
    except FileError:
        shutil.rmtree(target, ignore_errors=True)
        raise
    return target


def _require_inside(member: ZipInfo) -> None:
    parts = PurePosixPath(member.filename.replace("\\", "/"))
    link = (member.external_attr >> 16) & 0o170000 == 0o120000
    if link or parts.is_absolute() or ".." in parts.parts or re.match(r"\w:", member.filename):
        raise FileError(f"{member.filename!r} leads out of the zip; it is not unpacked")


def robot_model(unpacked: Path) -> Path | None:
    """Return the robot's model among unpacked files; None without one.

    A model has joints, and no other model names its file. Of several, the one in the shallowest folder is returned, and in one
    folder the one without "scene" in its name.
    """
    found = [path for path in sorted(unpacked.rglob("*")) if path.suffix.lower() in MODELS]
    texts = {path: path.read_text(encoding="utf-8", errors="replace") for path in found}
    robots = [path for path, text in texts.items() if re.search(r"<(mujoco|robot)\b", text) and "<joint" in text]
    whole = [path for path in robots if not any(path.name in texts[other] for other in robots if other != path)]
    return min(whole or robots, key=lambda path: (len(path.parts), "scene" in path.stem, str(path)), default=None)


CLIPS = (".bvh", ".amc", ".c3d", ".glb", ".fbx", ".trc", ".mvnx", ".npz", ".npy", ".csv", ".json", ".pkl")
"""Suffixes of motions in order of preference: single-file formats of capture first."""


def motions_within(unpacked: Path) -> list[Path]:
    """Return the motions of an unpacked zip: its files of the first suffix in `CLIPS` that occurs.

    Raises:
        UsageError: it holds none.
    """
    files = [path for path in sorted(unpacked.rglob("*")) if path.is_file() and not path.name.startswith(".")]
    alike = [[path for path in files if path.suffix.lower() == suffix] for suffix in CLIPS]
    if not (found := next(filter(None, alike), [])):
        raise UsageError(f"{unpacked.name}.zip holds no motion ({', '.join(CLIPS)}) and no robot ({', '.join(MODELS)})")
    return found
