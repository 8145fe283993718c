"""Joints of a motion as bones of a VRM, for senders."""

from dataclasses import dataclass

import numpy as np

from robot_retarget.base.arrays import Floats
from robot_retarget.base.errors import UsageError
from robot_retarget.human.motion import Motion
from robot_retarget.human.recognition import Recognition
from robot_retarget.human.skeleton import backward
from robot_retarget.live.protocols.bones import BONES, OPTIONAL, carriers

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
