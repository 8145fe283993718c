"""Sets of joints that arrays come in without naming them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


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


_HUMANML3D: dict[str, str | None] = {
    "pelvis": None, "left_hip": "pelvis", "right_hip": "pelvis", "spine1": "pelvis",
    "left_knee": "left_hip", "right_knee": "right_hip", "spine2": "spine1",
    "left_ankle": "left_knee", "right_ankle": "right_knee", "spine3": "spine2",
    "left_foot": "left_ankle", "right_foot": "right_ankle",
    "neck": "spine3", "left_collar": "spine3", "right_collar": "spine3", "head": "neck",
    "left_shoulder": "left_collar", "right_shoulder": "right_collar",
    "left_elbow": "left_shoulder", "right_elbow": "right_shoulder",
    "left_wrist": "left_elbow", "right_wrist": "right_elbow",
}  # fmt: skip
_SMPL = {**_HUMANML3D, "left_hand": "left_wrist", "right_hand": "right_wrist"}
_SOMA: dict[str, str | None] = {
    "Hips": None, "Spine1": "Hips", "Spine2": "Spine1", "Chest": "Spine2", "Neck1": "Chest", "Neck2": "Neck1",
    "Head": "Neck2", "Jaw": "Head", "LeftEye": "Head", "RightEye": "Head",
    "LeftShoulder": "Chest", "LeftArm": "LeftShoulder", "LeftForeArm": "LeftArm", "LeftHand": "LeftForeArm",
    "LeftHandThumbEnd": "LeftHand", "LeftHandMiddleEnd": "LeftHand",
    "RightShoulder": "Chest", "RightArm": "RightShoulder", "RightForeArm": "RightArm", "RightHand": "RightForeArm",
    "RightHandThumbEnd": "RightHand", "RightHandMiddleEnd": "RightHand",
    "LeftLeg": "Hips", "LeftShin": "LeftLeg", "LeftFoot": "LeftShin", "LeftToeBase": "LeftFoot",
    "RightLeg": "Hips", "RightShin": "RightLeg", "RightFoot": "RightShin", "RightToeBase": "RightFoot",
}  # fmt: skip

JOINT_SETS = (
    JointSet("the 22 joints of HumanML3D and SMPL", _HUMANML3D, 20.0),
    JointSet("the 24 joints of SMPL", _SMPL, 30.0),
    JointSet("the 30 joints of SOMA", _SOMA, 30.0),
)
