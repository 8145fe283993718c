"""Joint positions as arrays: `.npy` and `.npz` of shape (T, J, 3), with joint names or from a known set of joints."""

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


@dataclass(frozen=True)
class JointSet:
    """Joints in the order of an array, and the frame rate its data usually has [1/s]."""

    title: str
    parents: Mapping[str, str | None]
    """Each joint's parent by name, None at the root."""
    fps: float

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.parents)

    def parent_indices(self, order: Sequence[str]) -> list[int]:
        """For each joint in another order the index of its parent there, −1 at the root."""
        return [-1 if (parent := self.parents[name]) is None else list(order).index(parent) for name in order]


HUMANML3D: dict[str, str | None] = {
    "pelvis": None, "left_hip": "pelvis", "right_hip": "pelvis", "spine1": "pelvis",
    "left_knee": "left_hip", "right_knee": "right_hip", "spine2": "spine1",
    "left_ankle": "left_knee", "right_ankle": "right_knee", "spine3": "spine2",
    "left_foot": "left_ankle", "right_foot": "right_ankle",
    "neck": "spine3", "left_collar": "spine3", "right_collar": "spine3", "head": "neck",
    "left_shoulder": "left_collar", "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder", "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow", "right_wrist": "right_elbow",
}  # fmt: skip
SMPL = {**HUMANML3D, "left_hand": "left_wrist", "right_hand": "right_wrist"}


def _soma_hand(side: str) -> dict[str, str | None]:
    """The joints below a hand of the full SOMA skeleton."""
    fingers = {"Thumb": 3, "Index": 4, "Middle": 4, "Ring": 4, "Pinky": 4}
    tree: dict[str, str | None] = {}
    for finger, joints in fingers.items():
        above = f"{side}Hand"
        for part in (*map(str, range(1, joints + 1)), "End"):
            name = f"{side}Hand{finger}{part}"
            tree[name], above = above, name
    return tree


_SOMA_FULL: dict[str, str | None] = {
    "Hips": None, "Spine1": "Hips", "Spine2": "Spine1", "Chest": "Spine2", "Neck1": "Chest", "Neck2": "Neck1",
    "Head": "Neck2", "HeadEnd": "Head", "Jaw": "Head", "LeftEye": "Head", "RightEye": "Head",
    "LeftShoulder": "Chest", "LeftArm": "LeftShoulder", "LeftForeArm": "LeftArm", "LeftHand": "LeftForeArm",
    **_soma_hand("Left"),
    "RightShoulder": "Chest", "RightArm": "RightShoulder", "RightForeArm": "RightArm", "RightHand": "RightForeArm",
    **_soma_hand("Right"),
    "LeftLeg": "Hips", "LeftShin": "LeftLeg", "LeftFoot": "LeftShin", "LeftToeBase": "LeftFoot",
    "LeftToeEnd": "LeftToeBase",
    "RightLeg": "Hips", "RightShin": "RightLeg", "RightFoot": "RightShin", "RightToeBase": "RightFoot",
    "RightToeEnd": "RightToeBase",
}  # fmt: skip


_SOMA = {
    name: f"{name[: name.index('Hand')]}Hand"
    if name.endswith("HandThumbEnd") or name.endswith("HandMiddleEnd")
    else parent
    for name, parent in _SOMA_FULL.items()
    if name.endswith(("HandThumbEnd", "HandMiddleEnd", "Hand")) or not ("Hand" in name or name.endswith("End"))
}
"""Of each hand the ends of two fingers; no ends of head and toes."""


def _fingers(hand: str, stem: str, fingers: tuple[str, ...]) -> dict[str, str | None]:
    """Three joints per finger below a hand, named by a stem, the finger and a number."""
    return {f"{stem}{f}{k}": f"{stem}{f}{k - 1}" if k > 1 else hand for f in fingers for k in (1, 2, 3)}


def _intermimic_side(side: str) -> dict[str, str | None]:
    arm = {f"{side}_Thorax": "Chest", f"{side}_Shoulder": f"{side}_Thorax", f"{side}_Elbow": f"{side}_Shoulder"}
    fingers = _fingers(f"{side}_Wrist", f"{side}_", ("Index", "Middle", "Pinky", "Ring", "Thumb"))
    return {**arm, f"{side}_Wrist": f"{side}_Elbow", **fingers}


_INTERMIMIC: dict[str, str | None] = {
    "Pelvis": None, "L_Hip": "Pelvis", "L_Knee": "L_Hip", "L_Ankle": "L_Knee", "L_Toe": "L_Ankle",
    "R_Hip": "Pelvis", "R_Knee": "R_Hip", "R_Ankle": "R_Knee", "R_Toe": "R_Ankle",
    "Torso": "Pelvis", "Spine": "Torso", "Chest": "Spine", "Neck": "Chest", "Head": "Neck",
    **_intermimic_side("L"), **_intermimic_side("R"),
}  # fmt: skip


def _holosoma_arm(side: str) -> dict[str, str | None]:
    arm = {f"{side}Shoulder": "Spine1", f"{side}Arm": f"{side}Shoulder", f"{side}ForeArm": f"{side}Arm"}
    fingers = _fingers(f"{side}Hand", f"{side}Hand", ("Thumb", "Index", "Middle", "Ring", "Pinky"))
    return {**arm, f"{side}Hand": f"{side}ForeArm", **fingers}


def _holosoma_leg(side: str) -> dict[str, str | None]:
    chain = ("Hips", *(f"{side}{part}" for part in ("UpLeg", "Leg", "Foot", "ToeBase")))
    return dict(zip(chain[1:], chain, strict=False))


_HOLOSOMA: dict[str, str | None] = {
    "Hips": None, "Spine": "Hips", "Spine1": "Spine", "Neck": "Spine1", "Head": "Neck",
    **_holosoma_arm("Left"), **_holosoma_arm("Right"), **_holosoma_leg("Left"), **_holosoma_leg("Right"),
    "LeftFootMod": "LeftFoot", "RightFootMod": "RightFoot",
}  # fmt: skip

JOINT_SETS = (
    JointSet("the 22 joints of HumanML3D and SMPL", HUMANML3D, 20.0),
    JointSet("the 24 joints of SMPL", SMPL, 30.0),
    JointSet("the 30 joints of SOMA", _SOMA, 30.0),
    JointSet("the 77 joints of SOMA", _SOMA_FULL, 30.0),
    JointSet("the 52 joints of SMPL-H in InterMimic's order", _INTERMIMIC, 30.0),
    JointSet("the 53 joints of holosoma's captures", _HOLOSOMA, 120.0),
)


POSITION_KEYS = ("positions", "joints", "posed_joints", "joint_positions", "joints3d", "xyz", "global_joint_positions")
ROTATION_KEYS = ("rotations", "global_rot_mats", "global_rotations")
OMNIRETARGET, OMNIRETARGET_FPS = "global_joint_positions", 30.0
"""Positions of OmniRetarget's AMASS files, and their rate [1/s]."""
NAME_KEYS = ("names", "joint_names")
CONTACT_KEYS = ("foot_contacts", "contacts")
"""(T, 4) of left heel, left toe, right heel, right toe, the order of Kimodo."""
CONTACT = 0.5
"""Where contacts are probabilities, from which on a part stands: more likely than not."""


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
    return Capture(skeleton, positions, rotations, rate, str(path), (*notes, *rate_notes), contacts)


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
        return next((joints for joints in JOINT_SETS if set(joints.names) == set(names)), None)
    for joints in JOINT_SETS:
        if len(joints.names) == count:
            return joints
    sets = (f"{len(joints.names)} ({joints.title})" for joints in JOINT_SETS)
    raise MotionError(f"{count} joints without names are no known set; {known(sets)}", file.path)


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
