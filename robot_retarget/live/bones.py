"""The bones of a humanoid as Unity and VRM call them, how their axes turn into ours.

Unity: x right, y up, z ahead, left-handed. Ours: x' = z, y' = −x, z' = y, a reflection M with det M = −1. Places turn as
M p, and a rotation (w, v) becomes (w, −M v); both hold for a bone's pose in its parent as well.
"""

from collections.abc import Collection, Sequence

from robot_retarget.human.readers.smpl import mean_skeleton
from robot_retarget.human.skeleton import Place, Turn

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
