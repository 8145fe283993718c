"""AMC files: the angles of the bones of an ASF skeleton, frame by frame (the format of the CMU library)."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Capture
from robot_retarget.human.kinematics import forward
from robot_retarget.human.readers.amc.skeleton import ANGLES, PLACES, Asf, Bone, parse_asf
from robot_retarget.human.readers.file_header import FileHeader
from robot_retarget.human.readers.request import Request

FPS = 120.0
"""Of the CMU library; an AMC says no frame rate [1/s]."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file begins as AMC does."""
    return any(line.strip().upper() == ":FULLY-SPECIFIED" for line in header.text.splitlines())


def read(path: Path, request: Request) -> Capture:
    """Read an AMC file and the ASF file next to it.

    Raises:
        MotionError: the folder has no skeleton, or one of both files is broken; names the line and the expected content.
    """
    asf_file = skeleton_beside(path)
    asf = parse_asf(asf_file.read_text(encoding="utf-8", errors="replace"), asf_file)
    values = _frames(path.read_text(encoding="utf-8", errors="replace"), path, asf)
    skeleton = asf.skeleton()
    translations = np.tile(skeleton.offsets, (len(values["root"]), 1, 1))
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (*translations.shape[:2], 1))
    for joint, bone in enumerate(asf.bones):
        translations[:, joint] += _moved(bone, values[bone.name])
        turns[:, joint] = _turned(bone, values[bone.name], asf.degrees)
    positions, rotations = forward(skeleton.parents, translations, turns)
    fps, notes = request.rate(usual=FPS)
    return Capture(
        skeleton, positions, rotations, fps, str(path), (f"The skeleton is that of {asf_file.name}.", *notes)
    )


def beside(path: Path) -> tuple[Path, ...]:
    """Return the ASF of an AMC; None without one."""
    try:
        return (skeleton_beside(path),)
    except MotionError:
        return ()


def skeleton_beside(path: Path) -> Path:
    """The ASF of an AMC: called as the file, or as its subject (`02.asf` of `02_01.amc`), or the only one in the folder.

    Raises:
        MotionError: the folder has no ASF, or several.
    """
    folder = sorted(one for one in path.parent.iterdir() if one.suffix.lower() == ".asf")
    subject = path.stem.partition("_")[0]
    for stem in (path.stem, subject):
        called = [one for one in folder if one.stem.lower() == stem.lower()]
        if called:
            return called[0]
    if len(folder) == 1:
        return folder[0]
    found = f"; there are {', '.join(one.name for one in folder)}" if folder else ""
    raise MotionError(f"needs its skeleton next to it, {subject}.asf or {path.stem}.asf{found}", path)


def _frames(text: str, path: Path, asf: Asf) -> dict[str, Floats]:
    """The numbers (T, D) of every bone, in the order of its degrees of freedom."""
    wanted = {bone.name: bone.dof for bone in asf.bones if bone.dof}
    rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
    frames, line = 0, 0
    for line, content in enumerate(text.splitlines(), 1):
        words = content.split()
        if not words or words[0][0] in "#:":
            continue
        if len(words) == 1 and words[0].isdecimal():
            _check_whole(rows, frames, path, line)
            frames += 1
        else:
            _take(words, rows, wanted, frames, path, line)
    if not frames:
        raise MotionError("expected frames, a number and then a line a bone; found none", path, max(line, 1))
    _check_whole(rows, frames, path, line)
    return {bone.name: np.array(rows.get(bone.name, [[]] * frames), dtype=float) for bone in asf.bones}


def _take(
    words: list[str],
    rows: dict[str, list[list[float]]],
    wanted: dict[str, tuple[str, ...]],
    frames: int,
    path: Path,
    line: int,
) -> None:
    """One line of a frame: a bone and its numbers."""
    name, dof = words[0], wanted.get(words[0])
    if dof is None:
        raise MotionError(f"the skeleton has no bone {name!r} that moves", path, line)
    if len(rows[name]) >= frames:
        raise MotionError(f"a second line for {name!r} in one frame; expected the next frame's number", path, line)
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if len(numbers) != len(dof) or not np.isfinite(numbers).all():
        raise MotionError(
            f"{name!r}: expected {len(dof)} finite numbers ({' '.join(dof)}), found {words[1:]}", path, line
        )
    rows[name].append(numbers)


def _check_whole(rows: dict[str, list[list[float]]], frames: int, path: Path, line: int) -> None:
    missing = [name for name, numbers in rows.items() if len(numbers) < frames]
    if missing:
        raise MotionError(f"frame {frames} ends without {missing[0]!r}: truncated, or of another skeleton", path, line)


def _moved(bone: Bone, values: Floats) -> Floats:
    """(T, 3) how far a bone is from where its parent ends; a change of length is not followed."""
    place = np.zeros((len(values), 3))
    for column, freedom in enumerate(bone.dof):
        if freedom in PLACES:
            place[:, PLACES.index(freedom)] = values[:, column]
    return place


def _turned(bone: Bone, values: Floats, degrees: bool) -> Floats:
    """(T, 4) L = C M C⁻¹ of a bone, w x y z; the angles of M turn about fixed axes, in the order of the freedoms."""
    columns = [column for column, freedom in enumerate(bone.dof) if freedom in ANGLES]
    turn = Rotation.identity(len(values))
    for column in columns:
        turn = Rotation.from_euler(bone.dof[column][1], values[:, column, None], degrees=degrees) * turn
    if bone.axis is not None:
        turn = bone.axis * turn * bone.axis.inv()
    return turn.as_quat(scalar_first=True)
