"""Joint positions as arrays: `.npy` and `.npz` of shape (T, J, 3), with joint names or from a known set of joints."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robot_retarget.base.arrays import Bools, Floats, Ints
from robot_retarget.base.errors import MotionError, known
from robot_retarget.base.untrusted.arrays import load_arrays, rate_of
from robot_retarget.base.untrusted.rotations import checked_quaternions, quaternions_of_matrices
from robot_retarget.human.capture import USUAL_FPS, Capture, FileHeader, Request
from robot_retarget.human.readers.points import bridged_turns
from robot_retarget.human.skeleton import Skeleton, backward, sorted_tree

# Sets of joints that arrays come in without naming them.

SKELETONS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("skeletons.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class JointSet:
    """Joints in the order of an array, and the frame rate its data usually has [1/s]."""

    title: str
    fps: float
    parents: Mapping[str, str]
    """Each joint's parent by name, empty at the root."""
    places: Mapping[str, Sequence[float]] | None = None
    """Place of each joint in its parent [m], of a set that has a mean body."""
    camera: bool = False
    """Whether networks write it in the frame of a camera."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.parents)

    def parent_indices(self, order: Sequence[str]) -> list[int]:
        """For each joint in another order the index of its parent there, −1 at the root."""
        return [list(order).index(parent) if (parent := self.parents[name]) else -1 for name in order]


JOINT_SETS = {name: JointSet(**table) for name, table in SKELETONS.items() if "parents" in table}
HUMANML3D, SMPL = JOINT_SETS["humanml3d"], JOINT_SETS["smpl"]


POSITION_KEYS = ("positions", "joints", "posed_joints", "joint_positions", "joints3d", "xyz", "global_joint_positions")
ROTATION_KEYS = ("rotations", "global_rot_mats", "global_rotations")
OMNIRETARGET, OMNIRETARGET_FPS = "global_joint_positions", 30.0
"""Positions of OmniRetarget's AMASS files, and their rate [1/s]."""
NAME_KEYS = ("names", "joint_names")
CONTACT_KEYS = ("foot_contacts", "contacts")
"""(T, 4) of left heel, left toe, right heel, right toe, the order of Kimodo."""
CONTACT = 0.5
"""Where contacts are probabilities, from which on a part stands: 0.5, by definition as likely as not."""


def matches_format(header: FileHeader) -> bool:
    """Whether a file holds an array of positions, in any shape."""
    positions = header.arrays & set(POSITION_KEYS)
    return bool(positions or header.shape or (header.arrays and header.path.suffix.lower() == ".npz"))


def read(path: Path, request: Request) -> Capture:
    """Read an array of joint positions (T, J, 3).

    An `.npz` may hold `names`, `parents`, `fps`, rotations in the world frame, (T, J, 4) w x y z or (T, J, 3, 3), and the
    contacts of the feet (T, 4). Without names the number of joints says which known set they are. The skeleton's offsets
    are those of the first frame.

    Raises:
        MotionError: the array is missing, a shape is wrong, no known set has the joints, or a number is not finite.
    """
    return captured(load_arrays(path), path, request)


def captured(arrays: Mapping[str, Any], path: Path, request: Request) -> Capture:
    """Make a capture of named arrays of a file; `read` states them and its errors."""
    file = _File(path, arrays)
    positions = file.positions()
    count = positions.shape[1]
    called = file.names(request.names, count)
    joints = _known_set(file, called, count)
    notes: tuple[str, ...] = ()
    if joints is not None and not called:
        called, notes = joints.names, (f"{count} joints without names: read as {joints.title}.",)
        _require_order(joints, positions, path)
    parents, order = file.tree(called, joints)
    rotations = file.rotations(positions)
    usual = OMNIRETARGET_FPS if OMNIRETARGET in arrays else joints.fps if joints else USUAL_FPS
    rate, rate_notes = request.rate(rate_of(file.arrays), usual)
    if rotations is not None:
        rotations, gaps = bridged_turns(rotations, called, rate, str(path))
        rate_notes = (*rate_notes, *gaps)
    positions, rotations = positions[:, order], None if rotations is None else rotations[:, order]
    skeleton = Skeleton(tuple(called[k] for k in order), parents, first_offsets(parents, positions, rotations))
    contacts = file.contacts(len(positions))
    if contacts is not None:
        rate_notes = (*rate_notes, "The file says when the feet stand: its contacts are taken.")
    camera = joints is not None and joints.camera
    return Capture(skeleton, positions, rotations, rate, str(path), (*notes, *rate_notes), contacts, camera=camera)


@dataclass(frozen=True)
class _File:
    """The arrays of a file, each checked on access."""

    path: Path
    arrays: Mapping[str, Any]

    def first(self, keys: Sequence[str]) -> Any | None:
        return next((self.arrays[key] for key in keys if key in self.arrays), None)

    def positions(self) -> Floats:
        values = self.first(POSITION_KEYS)
        if values is None:
            shaped = [array for array in self.arrays.values() if array.ndim == 3 and array.shape[2] == 3]
            if len(shaped) != 1:
                listed = ", ".join(self.arrays) or "nothing"
                raise MotionError(f"no array of positions among {listed}; {known(POSITION_KEYS)}", self.path)
            values = shaped[0]
        if values.ndim != 3 or values.shape[2] != 3 or 0 in values.shape or values.dtype.kind not in "fiu":
            raise MotionError(f"positions must be numbers (T, J, 3), got {values.dtype} {values.shape}", self.path)
        return values.astype(float)

    def names(self, given: Sequence[str] | None, count: int) -> tuple[str, ...]:
        """The joints' names, given or stored; empty if absent."""
        stored = self.first(NAME_KEYS)
        if given is None and stored is None:
            return ()
        names = tuple(given if given is not None else np.asarray(stored).astype(str).ravel().tolist())
        if len(names) != count or len(set(names)) != count:
            raise MotionError(f"{count} joints need as many different names, got {len(set(names))}", self.path)
        return names

    def tree(self, names: tuple[str, ...], joints: JointSet | None) -> tuple[Ints, Ints]:
        """Parents, before their children, and the order of the joints that makes it so."""
        stored = self.arrays.get("parents")
        if stored is None and joints is None:
            raise MotionError("joint names need `parents`: each joint's parent by index, −1 at the root", self.path)
        parents = np.asarray(stored if stored is not None else joints and joints.parent_indices(names))
        count = len(names)
        if parents.shape != (count,) or parents.dtype.kind not in "iu" or parents.min() < -1 or parents.max() >= count:
            raise MotionError(f"parents must be {count} indices of joints, −1 at a root", self.path)
        try:
            return sorted_tree(parents)
        except ValueError as error:
            raise MotionError(str(error), self.path) from error

    def rotations(self, positions: Floats) -> Floats | None:
        values, shape = self.first(ROTATION_KEYS), positions.shape[:2]
        if values is None:
            return None
        if values.shape not in ((*shape, 4), (*shape, 3, 3)):
            raise MotionError(f"rotations must be {(*shape, 4)} or {(*shape, 3, 3)}, got {values.shape}", self.path)
        if values.ndim == 4:
            return quaternions_of_matrices(values, "rotations")
        return checked_quaternions(values, "rotations", gaps=True)

    def contacts(self, frames: int) -> Bools | None:
        """(T, 4) the stored contacts of the feet, or None."""
        values = self.first(CONTACT_KEYS)
        if values is None:
            return None
        if values.shape != (frames, 4) or values.dtype.kind not in "biuf":
            raise MotionError(
                f"contacts must be ({frames}, 4) of left heel, left toe, right heel, right toe, got {values.shape}",
                self.path,
            )
        return values > CONTACT


def _known_set(file: _File, names: tuple[str, ...], count: int) -> JointSet | None:
    """The set that has these names, or without names this many joints."""
    if names:
        return next((joints for joints in JOINT_SETS.values() if set(joints.names) == set(names)), None)
    for joints in JOINT_SETS.values():
        if len(joints.names) == count:
            return joints
    sets = (f"{len(joints.names)} ({joints.title})" for joints in JOINT_SETS.values())
    raise MotionError(f"{count} joints without names are no known set; {known(sets)}", file.path)


def _require_order(joints: JointSet, positions: Floats, path: Path) -> None:
    """Require thighs that are longer than the hips are wide, for a set whose number of joints other sets share.

    Raises:
        MotionError: they are shorter.
    """
    if not joints.camera:
        return
    pelvis, hip, knee = (positions[:, joints.names.index(name)] for name in ("pelvis", "right_hip", "right_knee"))
    thigh, half = (np.median(np.linalg.norm(a - hip, axis=1)) for a in (knee, pelvis))
    if thigh < 2 * half:
        raise MotionError(f"not {joints.title} in their order: give the joints' names and parents", path)


def first_offsets(parents: Ints, positions: Floats, rotations: Floats | None) -> Floats:
    """(J, 3) each joint's place in its parent in the first frame; 0 at a root.

    Args:
        parents: (J,) index of each joint's parent, −1 at a root.
        positions: (T, J, 3) [any unit].
        rotations: (T, J, 4) w x y z, or None for a world frame at every joint.
    """
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(parents), 1))
    offsets, _ = backward(parents, positions[:1], identity if rotations is None else rotations[:1])
    return np.where(parents[:, None] < 0, 0.0, offsets[0])
