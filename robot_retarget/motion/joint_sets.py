"""Sets of joints that arrays come in without naming them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class JointSet:
    """Names and parents of a set of joints, and the frame rate its data usually has [1/s]."""

    title: str
    names: tuple[str, ...]
    parents: tuple[int, ...]
    fps: float | None


_SMPL = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
]
_SMPL_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
_SOMA = [
    "Hips",
    "Spine1",
    "Spine2",
    "Chest",
    "Neck1",
    "Neck2",
    "Head",
    "Jaw",
    "LeftEye",
    "RightEye",
    "LeftShoulder",
    "LeftArm",
    "LeftForeArm",
    "LeftHand",
    "LeftHandThumbEnd",
    "LeftHandMiddleEnd",
    "RightShoulder",
    "RightArm",
    "RightForeArm",
    "RightHand",
    "RightHandThumbEnd",
    "RightHandMiddleEnd",
    "LeftLeg",
    "LeftShin",
    "LeftFoot",
    "LeftToeBase",
    "RightLeg",
    "RightShin",
    "RightFoot",
    "RightToeBase",
]
_SOMA_PARENTS = (
    -1,
    0,
    1,
    2,
    3,
    4,
    5,
    6,
    6,
    6,
    3,
    10,
    11,
    12,
    13,
    13,
    3,
    16,
    17,
    18,
    19,
    19,
    0,
    22,
    23,
    24,
    0,
    26,
    27,
    28,
)

JOINT_SETS = (
    JointSet("the 22 joints of HumanML3D and SMPL", tuple(_SMPL[:22]), _SMPL_PARENTS[:22], 20.0),
    JointSet("the 24 joints of SMPL", tuple(_SMPL), _SMPL_PARENTS, 30.0),
    JointSet("the 30 joints of SOMA", tuple(_SOMA), _SOMA_PARENTS, 30.0),
)
