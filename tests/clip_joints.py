"""What the keypoints of every shared human clip are, read off its hierarchy by eye."""

SCHEMES = {
    # Of a side: shoulder, elbow, hand, hip, knee, ankle, toe.
    "humanik": "{}Arm {}ForeArm {}Hand {}UpLeg {}Leg {}Foot {}ToeBase",
    "humanik, no toes": "{}Arm {}ForeArm {}Hand {}UpLeg {}Leg {}Foot {}Foot_end",
    "lafan1": "{}Arm {}ForeArm {}Hand {}UpLeg {}Leg {}Foot {}Toe",
    "mixamo": "{0}Arm {0}ForeArm {0}Hand {0}UpLeg {0}Leg {0}Foot {0}ToeBase",
    "soma": "{}Arm {}ForeArm {}Hand {}Leg {}Shin {}Foot {}ToeBase",
    "xsens": "{}Shoulder {}Elbow {}Wrist {}Hip {}Knee {}Ankle {}Toe",
    "biovision": "{}Shoulder {}Elbow {}Wrist {}Hip {}Knee {}Ankle {}Ankle_end",
    "wisconsin": "{}UpArm {}LowArm {}Hand {}UpLeg {}LowLeg {}Foot",  # its feet end straight below the ankles
    "poser": "{}Shldr {}ForeArm {}Hand {}Thigh {}Shin {}Foot {}Foot_end",
    "makehuman": "upperarm01.{0} lowerarm01.{0} wrist.{0} upperleg01.{0} lowerleg01.{0} foot.{0} toe1-1.{0}",
    "makehuman, old": "UpArm_{0} LoArm_{0} Hand_{0} UpLeg_{0} LoLeg_{0} Foot_{0} Toe_{0}",
    "xsens, numbered": "{0}Shoulder-{1} {0}Elbow-{2} {0}Wrist-{3} {0}Hip-{4} {0}Knee-{5} {0}Ankle-{6} {0}Toe-{7}",
}
_SIDES = ("Left", "Right")
_MIXAMO = ("mixamorig:Left", "mixamorig:Right")
_NUMBERED = (("Left", 14, 15, 16, 23, 24, 25, 26), ("Right", 9, 10, 11, 18, 19, 20, 21))

CLIPS = {
    # Clip: scheme, what stands for left and right, chest, neck and head, metres in its unit (None: no known one), up.
    "cmu_cgspeed_motionbuilder/02_01_walk": ("humanik", _SIDES, "Spine1 Neck1 Head", 0.0564, "+y"),
    "cmu_cgspeed_motionbuilder/05_06_dance": ("humanik", _SIDES, "Spine1 Neck1 Head", 0.0564, "+y"),
    "cmu_cgspeed_motionbuilder/walk_01_mixed_eol": ("humanik", _SIDES, "Spine1 Neck1 Head", 0.0564, "+y"),
    "cmu_cgspeed_motionbuilder/npybvh_example_run": ("humanik", _SIDES, "Spine1 Neck1 Head", 0.0564, "+y"),
    "cmu_daz_friendly/05_pirouette_daz": ("poser", "lr", "chest neck head", 0.01, "+y"),
    "cmu_hahne_3dsmax/jumping_jacks": ("xsens", _SIDES, "Chest2 Neck Head", 0.0564, "+y"),
    "fair1_zup/dab": ("humanik", _SIDES, "Spine3 Neck Head", None, "+z"),
    "fair1_zup/jumping": ("humanik", _SIDES, "Spine3 Neck Head", None, "+z"),
    "fair1_zup/wave_hello": ("humanik", _SIDES, "Spine3 Neck Head", None, "+z"),
    "perception_neuron/jesse_dance_rokoko_dir": ("humanik", _SIDES, "Spine2 Neck Head", 0.01, "+y"),
    "captury_like_mixed_orders/bvh_example_zup": ("humanik", _SIDES, "Spine3 Neck1 Head", 0.0254, "+z"),
    "xsens_mvn/bvh_test2": ("xsens", _SIDES, "Chest4 Neck Head", 0.01, "+y"),
    "xsens_mvn/BVH2SMPL_Sit54": ("xsens", _SIDES, "Chest4 Neck Head", 0.01, "+y"),
    "biovision_classic/mocapbank_sit": ("biovision", _SIDES, "Chest2 Neck Head", 0.01, "+y"),
    "biovision_classic/Example1_wisc": ("wisconsin", _SIDES, "Chest Neck Head", 0.0254, "+y"),
    "humanik_generic/walk01_ot": ("humanik, no toes", _SIDES, "Spine1 Neck Head", 0.01, "+y"),
    "mixamo/test_freebvh_walk": ("mixamo", _MIXAMO, "mixamorig:Spine2 mixamorig:Neck mixamorig:Head", 0.01, "+y"),
    "lafan1_procedural/wave_procedural": ("lafan1", _SIDES, "Spine2 Neck Head", 0.01, "+y"),
    "lafan1_procedural/backflip_procedural": ("lafan1", _SIDES, "Spine2 Neck Head", 0.01, "+y"),
    "lafan1_procedural/fall_getup_procedural": ("lafan1", _SIDES, "Spine2 Neck Head", 0.01, "+y"),
    "lafan1_procedural/walk_procedural": ("lafan1", _SIDES, "Spine2 Neck Head", 0.01, "+y"),
    "makehuman_zup/mh_walk1": ("makehuman, old", "LR", "Spine3 Neck Head", 0.1, "+z"),
    "makehuman_zup/mh_zombieWalk1": ("makehuman, old", "LR", "Spine3 Neck Head", 0.1, "+z"),
    "makehuman_zup/mh_dance1_1frame": ("makehuman, old", "LR", "Spine3 Neck Head", 0.1, "+z"),
    "makehuman_zup/mh_benchmark_1frame_163j": ("makehuman", "LR", "spine01 neck03 head", 0.1, "+z"),
    "makehuman_zup/mh_tpose_173j": ("makehuman", "LR", "spine01 neck03 head", 0.1, "+z"),
    "malformed_or_odd/bvh2smpl_EndSite_suffix": (
        "xsens, numbered", _NUMBERED, "Chest4-4 Neck-5 Head-6", 0.01, "+y",
    ),
    "soma30_derived/soma30_pick_up_from_ground": ("soma", _SIDES, "Chest Neck2 Head", 0.01, "+y"),
    "soma30_derived/soma30_walk_then_sneak": ("soma", _SIDES, "Chest Neck2 Head", 0.01, "+y"),
}  # fmt: skip

STRANGERS = {
    "nonhuman_negative/dog_walk_Bip01": "hands bear weight like feet",
    "malformed_or_odd/bvh_anim_test_simple": "no two legs found among its 3 joints",
    "malformed_or_odd/pybvh_rotation_first_root": "no two legs found among its 6 joints",
    "malformed_or_odd/pybvh_full_precision_frame_time": "no two legs found among its 3 joints",
    "malformed_or_odd/usd_test_bvh": "no two legs found among its 3 joints",
}

CALIBRATED = {
    # Clips whose first frame is a calibration pose; every other clip starts with its motion.
    "cmu_cgspeed_motionbuilder/walk_01_mixed_eol",
    "cmu_cgspeed_motionbuilder/npybvh_example_run",
    "cmu_daz_friendly/05_pirouette_daz",
    "xsens_mvn/BVH2SMPL_Sit54",
}


def expected(clip: str) -> dict[str, tuple[str, ...]]:
    """The joints of every keypoint of a clip."""
    scheme, sides, trunk, _, _ = CLIPS[clip]
    joints = {k: (name,) for k, name in zip(("chest", "neck", "head"), trunk.split(), strict=True)}
    for side, word in zip("lr", sides, strict=True):
        names = SCHEMES[scheme].format(*([word] * 7 if isinstance(word, str) else word)).split()
        parts = ("shoulder", "elbow", "hand", "hip", "knee", "ankle", "toe")
        joints |= {f"{side}_{part}": (name,) for part, name in zip(parts, names, strict=False)}
    return joints | {"pelvis": joints["l_hip"] + joints["r_hip"]}
