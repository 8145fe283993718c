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
