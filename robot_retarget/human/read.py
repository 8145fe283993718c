"""Read a motion file of any format: its content selects the reader, `upright` converts units and axes."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robot_retarget.base.errors import FileError, MotionError, UsageError
from robot_retarget.base.untrusted.limits import refusing
from robot_retarget.human.capture import Capture, Request, one_performer
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.table import format_of
from robot_retarget.human.upright import STATURES, upright


def read_motion(
    path: str | Path,
    *,
    fps: float | None = None,
    names: Sequence[str] | None = None,
    body_model: str | Path | None = None,
    up: str | None = None,
    repair: bool = True,
    height: float | None = None,
) -> Motion:
    """Read a human motion, in metres and z up.

    Args:
        path: a file of any format of `readers.table.FORMATS`; `FILE#NAME` is one of several motions in a file.

    Other arguments:
        fps: frames per second, in place of those in the file.
        names: joint names, for arrays that carry none.
        body_model: an `.npz` file with a body model, which gives the rest skeleton of SMPL parameters.
        up: the axis of the file that points up (`x`, `y`, `z`, `-y`, …), in place of the one inferred from the poses.
        repair: repair jumps, gaps under 0.3 s and noise; without, they are only reported.
        height: the human's stature, from which the scale is found, in place of the file's unit [m].

    Raises:
        MotionError: the file cannot be read, or the poses do not decide the up axis; names the line or field, or the frame and joint, and the expected content.
        UsageError: `fps` is not positive, `up` is no axis, or something is given that files of this format do not take.
    """
    file, clip = _part(Path(path))
    if fps is not None and not 0 < fps < float("inf"):
        raise UsageError(f"frames per second must be positive, got {fps}")
    if height is not None and not STATURES[0] <= height <= STATURES[1]:
        raise UsageError(f"height must be a stature from {STATURES[0]:g} to {STATURES[1]:g} m, got {height:g}")
    if file.is_dir():
        raise MotionError("is a folder; expected a motion file", file)
    if not file.exists():
        raise MotionError("no such file", file)
    capture, tree = _captured(file, Request(fps, names, clip, None if body_model is None else Path(body_model)))
    return replace(upright(capture, up, repair, height, tree), source_sha256=_hashed(file, clip))


def performers(path: str | Path) -> tuple[str, ...]:
    """Return the names of the people or motions in a file, each for `FILE#NAME`; nothing where it holds one.

    Raises:
        MotionError: as `read_motion`.
    """
    request = Request()
    one_performer(*_captured(Path(path), request))
    return tuple(request.listed)


def _captured(file: Path, request: Request) -> tuple[Capture, Request]:
    """Read a file; return its capture, and the request that selects one of several people in one joint tree."""
    try:
        chosen = format_of(file)
        _refuse_unused(request, chosen.takes, f"{file} ({chosen.name})")
        with refusing(file, chosen.name):
            capture = chosen.read(file, request)
    except FileError as error:
        raise MotionError(str(error)) from error
    except OSError as error:
        raise MotionError(f"cannot be read: {error.strerror or error}", file) from error
    return capture, replace(request, clip=None) if "clip" in chosen.takes else request


def as_motion(motion: Motion | str | Path, repair: bool = True) -> Motion:
    """Return a motion unchanged, or read it from a file (`read_motion`)."""
    return motion if isinstance(motion, Motion) else read_motion(motion, repair=repair)


def _hashed(file: Path, clip: str | None) -> str:
    """The hash of a file, and of the name of a motion in it."""
    with file.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256")
    digest.update((clip or "").encode())
    return digest.hexdigest()


def _part(path: Path) -> tuple[Path, str | None]:
    """`FILE#NAME` as the file and the name of a motion in it, which may have slashes; a file whose own name has a # is that file."""
    text = str(path)
    marks = [k for k, letter in enumerate(text) if letter == "#" and k]
    if not marks or path.exists():
        return path, None
    cut = next((k for k in marks if Path(text[:k]).is_file()), marks[-1])
    return Path(text[:cut]), text[cut + 1 :]


def _refuse_unused(request: Request, takes: frozenset[str], title: str) -> None:
    """Refuse arguments of `read_motion` that the reader of the format does not take."""
    for argument, sentence in _IDLE.items():
        if getattr(request, argument) is not None and argument not in takes:
            raise UsageError(f"{title}: {sentence}")


_IDLE = {
    "names": "joint names come from the file; give them for arrays only",
    "body_model": "it has its own skeleton; give a body model for SMPL parameters only",
}
