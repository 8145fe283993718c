"""A person of 1.75 m put together from the words of an exporter."""

import numpy as np

from robot_retarget.human.skeleton import Skeleton

STANDING = {
    "root": (0, 0, 0), "hips": (0, 0, 0.95), "waist": (0, 0, 1.05), "spine": (0, 0, 1.2), "chest": (0, 0, 1.3),
    "neck": (0, 0, 1.48), "head": (0.02, 0, 1.58), "crown": (0.02, 0, 1.75), "hip": (0, 0.09, 0.92), "knee": (0.02, 0.09, 0.49),
    "ankle": (-0.02, 0.09, 0.08), "toe": (0.11, 0.09, 0.02), "toe end": (0.19, 0.09, 0.01), "clavicle": (0, 0.03, 1.43),
    "shoulder": (-0.01, 0.18, 1.44), "elbow": (-0.03, 0.2, 1.15), "hand": (0.03, 0.21, 0.9), "finger": (0.04, 0.21, 0.81),
    "upper twist": (-0.02, 0.19, 1.3),
}  # fmt: skip
"""Where each part is: metres, z up, facing +x; the left one of two."""

CRAWLING = STANDING | {
    "hips": (0, 0, 0.45), "chest": (0.4, 0, 0.45), "neck": (0.52, 0, 0.47), "head": (0.62, 0, 0.48),
    "hip": (0, 0.1, 0.45), "knee": (0.02, 0.1, 0.03), "ankle": (-0.38, 0.1, 0.05), "toe": (-0.48, 0.1, 0.0),
    "clavicle": (0.45, 0.05, 0.45), "shoulder": (0.48, 0.18, 0.45), "elbow": (0.48, 0.18, 0.2), "hand": (0.48, 0.18, 0.0),
}  # fmt: skip

PLAIN = {
    # Name: part, parent's name; {} is the side.
    "pelvis": ("hips", None), "chest": ("chest", "pelvis"), "neck": ("neck", "chest"), "head": ("head", "neck"),
    "{}_hip": ("hip", "pelvis"), "{}_knee": ("knee", "{}_hip"), "{}_ankle": ("ankle", "{}_knee"), "{}_toe": ("toe", "{}_ankle"),
    "{}_clavicle": ("clavicle", "chest"), "{}_shoulder": ("shoulder", "{}_clavicle"), "{}_elbow": ("elbow", "{}_shoulder"),
    "{}_hand": ("hand", "{}_elbow"),
}  # fmt: skip
BIPED = {
    "Bip01": ("hips", None), "Bip01 Pelvis": ("hips", "Bip01"), "Bip01 Spine": ("waist", "Bip01 Pelvis"),
    "Bip01 Spine1": ("chest", "Bip01 Spine"), "Bip01 Neck": ("neck", "Bip01 Spine1"), "Bip01 Head": ("head", "Bip01 Neck"),
    "Bip01 HeadNub": ("crown", "Bip01 Head"),
    "Bip01 {} Thigh": ("hip", "Bip01 Spine"), "Bip01 {} Calf": ("knee", "Bip01 {} Thigh"), "Bip01 {} Foot": ("ankle", "Bip01 {} Calf"),
    "Bip01 {} Toe0": ("toe", "Bip01 {} Foot"), "Bip01 {} Toe0Nub": ("toe end", "Bip01 {} Toe0"),
    "Bip01 {} Clavicle": ("clavicle", "Bip01 Neck"), "Bip01 {} UpperArm": ("shoulder", "Bip01 {} Clavicle"),
    "Bip01 {} Forearm": ("elbow", "Bip01 {} UpperArm"), "Bip01 {} Hand": ("hand", "Bip01 {} Forearm"),
    "Bip01 {} Finger0": ("finger", "Bip01 {} Hand"),
}  # fmt: skip
KINECT = {
    "SpineBase": ("hips", None), "SpineMid": ("spine", "SpineBase"), "SpineShoulder": ("chest", "SpineMid"),
    "Neck": ("neck", "SpineShoulder"), "Head": ("head", "Neck"),
    "Hip{}": ("hip", "SpineBase"), "Knee{}": ("knee", "Hip{}"), "Ankle{}": ("ankle", "Knee{}"), "Foot{}": ("toe", "Ankle{}"),
    "Shoulder{}": ("shoulder", "SpineShoulder"), "Elbow{}": ("elbow", "Shoulder{}"), "Wrist{}": ("hand", "Elbow{}"),
    "Hand{}": ("finger", "Wrist{}"),
}  # fmt: skip
MMD = {
    "センター": ("hips", None), "上半身": ("waist", "センター"), "上半身2": ("chest", "上半身"), "首": ("neck", "上半身2"), "頭": ("head", "首"),
    "下半身": ("hips", "センター"), "{}足": ("hip", "下半身"), "{}ひざ": ("knee", "{}足"), "{}足首": ("ankle", "{}ひざ"), "{}つま先": ("toe", "{}足首"),
    "{}肩": ("clavicle", "上半身2"), "{}腕": ("shoulder", "{}肩"), "{}ひじ": ("elbow", "{}腕"), "{}手首": ("hand", "{}ひじ"), "{}中指": ("finger", "{}手首"),
}  # fmt: skip
UNREAL = {
    "root": ("root", None), "pelvis": ("hips", "root"), "spine_01": ("waist", "pelvis"), "spine_02": ("spine", "spine_01"),
    "spine_03": ("chest", "spine_02"), "neck_01": ("neck", "spine_03"), "head": ("head", "neck_01"),
    "thigh_{}": ("hip", "pelvis"), "calf_{}": ("knee", "thigh_{}"), "foot_{}": ("ankle", "calf_{}"), "ball_{}": ("toe", "foot_{}"),
    "clavicle_{}": ("clavicle", "spine_03"), "upperarm_{}": ("shoulder", "clavicle_{}"), "upperarm_twist_01_{}": ("upper twist", "upperarm_{}"),
    "lowerarm_{}": ("elbow", "upperarm_{}"), "hand_{}": ("hand", "lowerarm_{}"), "middle_01_{}": ("finger", "hand_{}"),
    "ik_foot_root": ("root", "root"), "ik_foot_{}": ("ankle", "ik_foot_root"), "ik_hand_root": ("root", "root"), "ik_hand_{}": ("hand", "ik_hand_root"),
}  # fmt: skip
WRAPPED = {
    "daito": ("root", None), "Solving": ("root", "daito"), "Hips": ("hips", "Solving"), "Spine": ("spine", "Hips"), "Spine1": ("chest", "Spine"),
    "Neck": ("neck", "Spine1"), "Head": ("head", "Neck"),
    "{}UpLeg": ("hip", "Hips"), "{}Leg": ("knee", "{}UpLeg"), "{}Foot": ("ankle", "{}Leg"), "{}ToeBase": ("toe", "{}Foot"),
    "{}Shoulder": ("clavicle", "Spine1"), "{}Arm": ("shoulder", "{}Shoulder"), "{}ForeArm": ("elbow", "{}Arm"), "{}Hand": ("hand", "{}ForeArm"),
}  # fmt: skip
BODIES = {
    "plain": (PLAIN, ("left", "right")),
    "3ds Max biped": (BIPED, ("L", "R")),
    "Kinect": (KINECT, ("Left", "Right")),
    "MikuMikuDance": (MMD, ("左", "右")),
    "Unreal": (UNREAL, ("l", "r")),
    "Vicon, two wrappers": (WRAPPED, ("Left", "Right")),
}


def body(
    tree: dict, sides: tuple[str, str], pose: dict = STANDING
) -> tuple[Skeleton, np.ndarray, dict[str, list[str]]]:
    """The skeleton, its joints (1, J, 3) and for each part the names that have it, left before right."""
    names: list[str] = []
    parents: list[int] = []
    points, parts = [], {}
    for name, (part, parent) in tree.items():
        for side, sign in zip(sides, (1, -1), strict=True):
            if "{}" in name or sign == 1:
                names.append(name.format(side))
                parents.append(-1 if parent is None else names.index(parent.format(side)))
                points.append(np.multiply(pose[part], (1, sign, 1)))
                parts.setdefault(part, []).append(names[-1])
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3))), np.array(points)[None], parts
