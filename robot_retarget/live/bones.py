"""The bones of a humanoid as Unity and VRM call them, how their axes turn into ours, and the bones of a motion for senders.

Unity: x right, y up, z ahead, left-handed. Ours: x' = z, y' = −x, z' = y, a reflection M with det M = −1. Places turn as
M p, and a rotation (w, v) becomes (w, −M v); both hold for a bone's pose in its parent as well.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.readers.smpl import mean_skeleton
from robot_retarget.human.recognition import Recognition
from robot_retarget.human.skeleton import Place, Turn, backward

_SIDED = {
    "UpperLeg": ("Hips", "hip"),
    "LowerLeg": ("UpperLeg", "knee"),
    "Foot": ("LowerLeg", "ankle"),
    "Toes": ("Foot", "foot"),
    "Shoulder": ("UpperChest", "collar"),
    "UpperArm": ("Shoulder", "shoulder"),
    "LowerArm": ("UpperArm", "elbow"),
    "Hand": ("LowerArm", "wrist"),
    "MiddleProximal": ("Hand", "hand"),
}
_MIDDLE = {
    "Hips": ("", "pelvis"),
    "Spine": ("Hips", "spine1"),
    "Chest": ("Spine", "spine2"),
    "UpperChest": ("Chest", "spine3"),
    "Neck": ("UpperChest", "neck"),
    "Head": ("Neck", "head"),
}
"""Parent of each bone, and its joint in the mean body."""
_TREE = dict(_MIDDLE)
for _side in ("Left", "Right"):
    _TREE |= {
        _side + bone: (carrier if carrier in _MIDDLE else _side + carrier, f"{_side.lower()}_{joint}")
        for bone, (carrier, joint) in _SIDED.items()
    }
BONES = tuple(_TREE)
"""Bones that define a pose, parents first."""
OPTIONAL = {"Chest", "UpperChest", "Neck"} | {
    side + bone for side in ("Left", "Right") for bone in ("Shoulder", "Toes", "MiddleProximal")
}
"""Bones that a VRM may lack."""
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
PASSED_OVER = {"LeftEye", "RightEye", "Jaw", "LastBone"} | {
    f"{side}{finger}{part}"
    for side in ("Left", "Right")
    for finger in _FINGERS
    for part in ("Proximal", "Intermediate", "Distal", "Metacarpal")
} - set(BONES)
"""Known bones that are ignored."""


def carriers(present: Collection[str]) -> dict[str, str]:
    """Return the nearest present ancestor of each present bone; empty for the hips."""
    found = {}
    for bone in BONES:
        if bone in present:
            carrier = _TREE[bone][0]
            while carrier and carrier not in present:
                carrier = _TREE[carrier][0]
            found[bone] = carrier
    return found


def mean_offsets(present: Collection[str]) -> dict[str, Place]:
    """Each bone's place in its carrier in the mean body in T-pose [m]; the hips' over the floor."""
    skeleton, _ = mean_skeleton(None)
    rest = skeleton.rest()
    rest[:, 1] -= rest[:, 1].min()
    at = {bone: rest[skeleton.names.index(joint), [2, 0, 1]] for bone, (_, joint) in _TREE.items()}
    place = {bone: at[bone] - (at[carrier] if carrier else 0) for bone, carrier in carriers(present).items()}
    return {bone: (float(x), float(y), float(z)) for bone, (x, y, z) in place.items()}


def place_of(p: Sequence[float]) -> Place:
    """A place of Unity's in our axes."""
    return p[2], -p[0], p[1]


def turn_of(q: Sequence[float]) -> Turn:
    """A quaternion x y z w of Unity's as w x y z in our axes."""
    return q[3], -q[2], q[0], -q[1]


def unity_place(p: Sequence[float] | Floats) -> list[float]:
    """The inverse of `place_of`."""
    return [float(-p[1]), float(p[2]), float(p[0])]


def unity_turn(q: Sequence[float] | Floats) -> list[float]:
    """The inverse of `turn_of`."""
    return [float(q[2]), float(-q[3]), float(-q[1]), float(q[0])]


_LIMBS = {
    "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "hand",
    "UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "Toes": "toe",
}  # fmt: skip
_TRUNK = {"Neck": "neck", "Head": "head"}


@dataclass(frozen=True, eq=False)
class HumanoidMotion:
    """The pose of each bone in what carries it, the hips' in the world; as `BONES` has them."""

    names: tuple[str, ...]
    places: Floats
    """(T, B, 3) [m]."""
    turns: Floats
    """(T, B, 4) unit w x y z."""


def humanoid(motion: Motion) -> HumanoidMotion:
    """The bones of a motion.

    Raises:
        UsageError: it has positions only, or a bone that a VRM must have is not among its joints.
        MatchError: it is not human.
    """
    if motion.rotations is None:
        raise UsageError(f"{motion.source or 'the motion'} has positions only: bones have rotations; send it as json")
    joints = _joints(motion.recognition, motion)
    lacking = [bone for bone in BONES if bone not in joints and bone not in OPTIONAL]
    if lacking:
        raise UsageError(f"{motion.source or 'the motion'} has no joint for {lacking[0]}")
    above = carriers(joints)
    names = tuple(above)
    parents = np.array([names.index(above[name]) if above[name] else -1 for name in names])
    chosen = [joints[name] for name in names]
    return HumanoidMotion(names, *backward(parents, motion.positions[:, chosen], motion.rotations[:, chosen]))


def _joints(recognition: Recognition, motion: Motion) -> dict[str, int]:
    """Return the joint of each bone; each joint serves one bone at most."""
    marks, above = recognition.marks, motion.skeleton.above
    legs = [marks[f"{side}_hip"].joints[0] for side in "lr"]
    head = marks["head" if "head" in marks else "neck"].joints[0]
    common = set.intersection(*(set(above(joint)[1:]) for joint in (*legs, head)))
    trunk = [joint for joint in reversed(above(head)[1:]) if joint > max(common, default=0)]
    found = {"Hips": max(common, default=0)}
    found |= {bone: marks[keypoint].joints[0] for bone, keypoint in _TRUNK.items() if keypoint in marks}
    spine = [joint for joint in trunk if joint not in found.values()]
    found |= dict(
        zip(("Spine", "Chest", "UpperChest"), [*spine[:2], *spine[-1:]] if len(spine) > 2 else spine, strict=False)
    )
    for side, letter in (("Left", "l"), ("Right", "r")):
        found |= {
            side + bone: marks[f"{letter}_{keypoint}"].joints[0]
            for bone, keypoint in _LIMBS.items()
            if f"{letter}_{keypoint}" in marks
        }
        collar = int(motion.skeleton.parents[found[f"{side}UpperArm"]])
        if collar not in found.values() and collar not in above(head):
            found[f"{side}Shoulder"] = collar
    return found
