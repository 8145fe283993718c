"""Names, tree and geometry together tell which joint is which, for every exporter and in any unit and axes."""

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bodies import BODIES, CRAWLING, PLAIN, STANDING, body
from clip_joints import CLIPS, STRANGERS, expected
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import MatchError
from robot_retarget.base.keypoints import KEYPOINTS, mirrored
from robot_retarget.human.capture import Capture
from robot_retarget.human.readers.bvh import read_bvh
from robot_retarget.human.recognition import Mark, Recognition, apply_override, recognise
from robot_retarget.human.recognition.limbs import name_evidence
from robot_retarget.human.skeleton import Skeleton

ONE_OF_EACH = (
    "cmu_cgspeed_motionbuilder/02_01_walk",
    "perception_neuron/jesse_dance_rokoko_dir",
    "captury_like_mixed_orders/bvh_example_zup",
    "biovision_classic/mocapbank_sit",
    "mixamo/test_freebvh_walk",
    "lafan1_procedural/backflip_procedural",
    "makehuman_zup/mh_walk1",
    "soma30_derived/soma30_walk_then_sneak",
)
JUDGED = {
    "cmu": "cmu_cgspeed_motionbuilder/02_01_walk",
    "cmu_hahne": "cmu_hahne_3dsmax/jumping_jacks",
    "fair1": "fair1_zup/dab",
    "perception_neuron": "perception_neuron/jesse_dance_rokoko_dir",
    "captury": "captury_like_mixed_orders/bvh_example_zup",
    "xsens": "xsens_mvn/bvh_test2",
    "lafan1": "lafan1_procedural/walk_procedural",
    "soma": "soma30_derived/soma30_walk_then_sneak",
    "biovision": "biovision_classic/mocapbank_sit",
    "cmu_daz": "cmu_daz_friendly/05_pirouette_daz",
}


@cache
def capture_of(clip: str) -> Capture:
    return read_bvh(SHARED / "motions" / "bvh" / f"{clip}.bvh")


def joints_of(recognition: Recognition, skeleton: Skeleton) -> dict[str, tuple[str, ...]]:
    return {keypoint: tuple(skeleton.names[j] for j in mark.joints) for keypoint, mark in recognition.marks.items()}


def renamed(skeleton: Skeleton, rename) -> Skeleton:
    return replace(skeleton, names=tuple(rename(k, name) for k, name in enumerate(skeleton.names)))


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
def test_every_keypoint_of_every_human_clip_is_found(clip):
    capture = capture_of(clip)
    recognition = recognise(capture.skeleton, capture.positions)
    assert joints_of(recognition, capture.skeleton) == expected(clip)
    assert set(recognition.missing) == set(KEYPOINTS) - expected(clip).keys()
    assert recognition.notes == ()
    assert recognition.confidence > 0.3
    assert min(mark.confidence for k, mark in recognition.marks.items() if not k.endswith("toe")) > 0.8


@needs_shared
def test_every_shared_clip_is_either_expected_or_refused():
    found = {f"{path.parent.name}/{path.stem}" for path in (SHARED / "motions" / "bvh").glob("*/*.bvh")}
    assert found == set(CLIPS) | set(STRANGERS)


@needs_shared
@pytest.mark.parametrize(("convention", "clip"), JUDGED.items(), ids=JUDGED)
def test_an_independent_map_names_the_same_joints(convention, clip):
    judged = json.loads((SHARED / "judge" / "skeletons" / f"{convention}.json").read_text())["joints"]
    skeleton = capture_of(clip).skeleton
    found = joints_of(recognise(skeleton, capture_of(clip).positions), skeleton)
    for keypoint, joints in judged.items():
        named = {joints} if isinstance(joints, str) else set(joints)
        if keypoint == "chest" and named != set(found[keypoint]):
            # The map's chest may stand one joint lower on the spine.
            parent = skeleton.parents[skeleton.names.index(found["chest"][0])]
            assert named == {skeleton.names[parent]}
        elif named <= set(skeleton.names):
            assert set(found[keypoint]) == named, keypoint


@needs_shared
@pytest.mark.parametrize(("clip", "reason"), STRANGERS.items(), ids=STRANGERS)
def test_what_is_not_human_is_refused_with_the_reason(clip, reason):
    with pytest.raises(MatchError, match=reason):
        recognise(capture_of(clip).skeleton, capture_of(clip).positions)


@needs_shared
def test_a_dog_without_names_is_refused_too():
    dog = capture_of("nonhuman_negative/dog_walk_Bip01")
    with pytest.raises(MatchError, match="not a human body"):
        recognise(renamed(dog.skeleton, lambda k, _: f"j{k}"), dog.positions)


@needs_shared
@settings(max_examples=8, deadline=None)
@given(clip=st.sampled_from(ONE_OF_EACH), seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([1e-3, 0.4, 1.0, 70.0]))
def test_unit_axes_and_place_do_not_matter(clip, seed, scale):
    capture = capture_of(clip)
    turn = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3) * 3).as_matrix()
    moved = scale * capture.positions @ turn.T + 100 * scale
    assert joints_of(recognise(capture.skeleton, moved), capture.skeleton) == expected(clip)


@needs_shared
@pytest.mark.parametrize("clip", ONE_OF_EACH)
def test_swapped_names_of_left_and_right_are_noticed_and_geometry_is_followed(clip):
    capture = capture_of(clip)
    other = {"l": "Right", "r": "Left", "": ""}

    def swap(k: int, name: str) -> str:
        found = name_evidence(name)
        return f"{other[found.side]}_{next(iter(found.parts), 'joint')}_{k}" if found.side else name

    swapped = renamed(capture.skeleton, swap)
    recognition = recognise(swapped, capture.positions)
    straight = recognise(capture.skeleton, capture.positions)
    for keypoint in ("l_hip", "r_knee", "l_shoulder", "r_hand"):
        assert recognition.marks[keypoint].joints == straight.marks[keypoint].joints
    assert "swapped" in recognition.notes[0]


@needs_shared
@pytest.mark.parametrize("clip", ONE_OF_EACH)
def test_a_mirrored_body_has_its_sides_exchanged(clip):
    capture = capture_of(clip)
    recognition = recognise(capture.skeleton, capture.positions * [-1, 1, 1])
    straight = recognise(capture.skeleton, capture.positions)
    for keypoint, mark in straight.marks.items():
        assert set(recognition.marks[mirrored(keypoint)].joints) == set(mark.joints)


NEED_NAMES = {
    "makehuman_zup/mh_dance1_1frame": {"l_shoulder", "r_shoulder", "l_hand", "r_hand"},
    "makehuman_zup/mh_tpose_173j": {"l_shoulder", "r_shoulder", "l_hand", "r_hand", "l_toe", "r_toe"},
}
"""Keypoints that tree and geometry alone place wrongly: fingers for hands in a clip of one frame."""


@needs_shared
@pytest.mark.parametrize("clip", CLIPS)
def test_names_that_mean_nothing_cost_certainty_and_not_the_limbs(clip):
    capture = capture_of(clip)
    blank = recognise(renamed(capture.skeleton, lambda k, _: f"j{k}"), capture.positions)
    named = recognise(capture.skeleton, capture.positions)
    wrong = {k for k, mark in named.marks.items() if k not in blank.marks or blank.marks[k].joints != mark.joints}
    assert wrong == NEED_NAMES.get(clip, set())
    assert max(mark.confidence for mark in blank.marks.values()) < 0.7
    assert all(blank.marks[k].confidence < 0.5 for k in wrong & blank.marks.keys())


GERMAN = {
    "pelvis": "Becken", "chest": "Brust", "neck": "Hals", "head": "Kopf", "clavicle": "Schlüsselbein",
    "shoulder": "Oberarm", "elbow": "Ellbogen", "hand": "Handgelenk", "hip": "Hüfte", "knee": "Knie",
    "ankle": "Knöchel", "toe": "Zehe",
}  # fmt: skip


@needs_shared
def test_other_languages_are_understood():
    capture = capture_of("lafan1_procedural/walk_procedural")
    keypoints = expected("lafan1_procedural/walk_procedural")
    called = {joints[0]: keypoint for keypoint, joints in keypoints.items() if keypoint != "pelvis"}

    def german(k: int, name: str) -> str:
        keypoint = called.get(name, "")
        side = {"l_": "linke ", "r_": "rechte "}.get(keypoint[:2], "")
        word = GERMAN.get(keypoint[2:] if side else keypoint)
        return f"{side}{word}" if word else f"j{k}"

    recognition = recognise(renamed(capture.skeleton, german), capture.positions)
    assert {k: m.joints for k, m in recognition.marks.items()} == {
        k: m.joints for k, m in recognise(capture.skeleton, capture.positions).marks.items()
    }
    assert recognition.confidence > 0.8


@needs_shared
def test_a_sword_a_ponytail_and_a_twist_joint_confuse_nothing():
    clip = "lafan1_procedural/walk_procedural"
    capture = capture_of(clip)
    names = capture.skeleton.names
    hand, elbow, arm, head = (names.index(name) for name in ("RightHand", "RightForeArm", "RightArm", "Head"))
    x = capture.positions
    along = x[:, hand] - x[:, elbow]
    added = {
        "Sword": (hand, x[:, hand] + 2 * along),
        "SwordTip": (len(names), x[:, hand] + 5 * along),
        "RightArmTwist": (arm, (x[:, arm] + x[:, elbow]) / 2),
        "Ponytail1": (head, x[:, head] - [0, 5, 12]),
        "Ponytail2": (len(names) + 3, x[:, head] - [0, 30, 14]),
    }
    skeleton = Skeleton(
        (*names, *added),
        np.append(capture.skeleton.parents, [parent for parent, _ in added.values()]),
        np.vstack([capture.skeleton.offsets, np.zeros((len(added), 3))]),
    )
    positions = np.concatenate([x, np.stack([at for _, at in added.values()], axis=1)], axis=1)
    assert joints_of(recognise(skeleton, positions), skeleton) == expected(clip)


@pytest.mark.parametrize(("tree", "sides"), BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("travel", [0, 30])
def test_exporters_without_a_clip_are_matched_from_one_pose_or_many(tree, sides, travel):
    skeleton, pose, parts = body(tree, sides)
    # A root that stays where it is while the body walks away.
    steps = np.arange(max(travel, 1))[:, None, None] * [[[0.1, 0, 0]]]
    still = np.array([name in parts.get("root", []) for name in skeleton.names])[None, :, None]
    recognition = recognise(skeleton, np.asarray(pose + steps * ~still, dtype=float))
    found = joints_of(recognition, skeleton)
    for part in ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "hand"):
        own = [name for name in parts[part] if not name.startswith("ik")]
        assert [found[f"{side}_{part}"][0] for side in "lr"] == own
    for part in ("chest", "neck", "head"):
        assert list(found[part]) == parts[part]


@pytest.mark.parametrize(("tree", "sides"), BODIES.values(), ids=BODIES)
def test_names_carry_a_body_of_odd_proportions(tree, sides):
    """Upper arms a third as long, as on a cartoon or a robot: the names of both arms tell what lengths do not."""
    skeleton, pose, parts = body(tree, sides)
    pose = np.array(pose, dtype=float)
    for shoulder, elbow in zip(parts["shoulder"], parts["elbow"], strict=True):
        at, moved = skeleton.names.index(shoulder), skeleton.names.index(elbow)
        below = [moved in skeleton.above(joint) for joint in range(len(skeleton))]
        pose[:, below] -= 0.67 * (pose[:, moved] - pose[:, at])
    found = joints_of(recognise(skeleton, pose), skeleton)
    for part in ("hip", "knee", "ankle", "shoulder", "elbow", "hand"):
        own = [name for name in parts[part] if not name.startswith("ik")]
        assert [found[f"{side}_{part}"][0] for side in "lr"] == own


def heeled(name: str, toe: bool) -> dict:
    """A plain body whose ankles carry a heel, long and first, and perhaps the toes beside it."""
    tree = {part: what for part, what in PLAIN.items() if part != "{}_toe"}
    tree |= {name: ("heel", "{}_ankle")} | ({"{}_toe": PLAIN["{}_toe"]} if toe else {})
    return tree


HEELED = STANDING | {"heel": (-0.2, 0.09, 0.0)}


def test_a_heel_beside_the_toes_is_no_toe():
    skeleton, pose, _ = body(heeled("{}_heel", toe=True), ("left", "right"), HEELED)
    found = joints_of(recognise(skeleton, pose), skeleton)
    assert (found["l_toe"], found["l_hand"]) == (("left_toe",), ("left_hand",))


def test_a_joint_straight_below_the_ankle_is_no_toe():
    """Some captures have the middle of the foot there; feet would have no heading."""
    tree = {part: what for part, what in PLAIN.items() if part != "{}_toe"}
    tree |= {"{}_forefoot": ("under", "{}_ankle"), "{}_toe": ("toe", "{}_forefoot")}
    ankle = STANDING["ankle"]
    skeleton, pose, _ = body(tree, ("left", "right"), STANDING | {"under": (ankle[0], ankle[1], ankle[2] - 0.05)})
    assert joints_of(recognise(skeleton, pose), skeleton)["l_toe"] == ("left_toe",)


@pytest.mark.parametrize("name", ["{}_heel", "{}_foot_x"])
def test_a_heel_instead_of_toes_mirrors_nobody(name):
    skeleton, pose, _ = body(heeled(name, toe=False), ("left", "right"), HEELED)
    recognition = recognise(skeleton, pose)
    assert joints_of(recognition, skeleton)["l_hand"] == ("left_hand",)
    assert {"l_toe", "r_toe"} <= set(recognition.missing)
    assert not any("swapped" in note for note in recognition.notes)


@needs_shared
@pytest.mark.parametrize("clip", ["fair1_zup/wave_hello", "perception_neuron/jesse_dance_rokoko_dir"])
def test_a_clavicle_is_no_shoulder_in_any_single_frame(clip):
    capture = capture_of(clip)
    for frame in range(0, len(capture.positions), 50):
        recognition = recognise(capture.skeleton, capture.positions[frame : frame + 1])
        assert joints_of(recognition, capture.skeleton) == expected(clip)


def test_limbs_called_tails_are_no_limbs():
    tree = {
        name.replace("{}_knee", "{}_tail_1"): (part, parent and parent.replace("{}_knee", "{}_tail_1"))
        for name, (part, parent) in PLAIN.items()
    }
    skeleton, pose, _ = body(tree, ("left", "right"))
    with pytest.raises(MatchError, match="is called a tail"):
        recognise(skeleton, pose)


def test_a_human_on_hands_and_knees_is_still_human():
    """Trunk level, arms and thighs down, shins back: the posture of a dog with the proportions of a person."""
    skeleton, pose, _ = body(PLAIN, ("left", "right"), CRAWLING)
    assert joints_of(recognise(skeleton, pose), skeleton)["l_hand"] == ("left_hand",)


def test_the_same_body_with_the_legs_of_a_dog_is_refused():
    hound = CRAWLING | {"knee": (0.03, 0.1, 0.24), "ankle": (-0.03, 0.1, 0.03), "toe": (0.05, 0.1, 0.0)}
    skeleton, pose, _ = body(PLAIN, ("left", "right"), hound)
    with pytest.raises(MatchError, match="hands bear weight like feet"):
        recognise(skeleton, pose)


@pytest.mark.parametrize("lacking", ["clavicle shoulder elbow hand", "hip knee ankle toe"])
def test_a_body_without_arms_or_legs_is_refused(lacking):
    parts = [f"{{}}_{part}" for part in lacking.split()]
    skeleton, pose, _ = body({name: what for name, what in PLAIN.items() if name not in parts}, ("left", "right"))
    with pytest.raises(MatchError, match="one pair of limbs found, not two legs and two arms"):
        recognise(skeleton, pose)


def test_what_a_body_lacks_is_said():
    lacking = ("{}_toe", "head")
    skeleton, pose, _ = body({name: what for name, what in PLAIN.items() if name not in lacking}, ("left", "right"))
    assert set(recognise(skeleton, pose).missing) == {"l_toe", "r_toe", "neck"}


@needs_shared
def test_an_override_sets_a_keypoint_and_unknown_words_are_refused_with_the_known_ones():
    capture = capture_of("lafan1_procedural/walk_procedural")
    skeleton = capture.skeleton
    found = recognise(skeleton, capture.positions)
    changed = apply_override(found, skeleton, {"chest": "Spine1", "l_toe": ["LeftToe", "LeftToe_end"]})
    assert changed.marks["chest"] == Mark((skeleton.names.index("Spine1"),), 1.0, "set by hand")
    assert len(changed.marks["l_toe"].joints) == 2
    assert changed.marks["r_toe"] == found.marks["r_toe"]
    with pytest.raises(
        MatchError, match=re.escape("unknown keypoint 'l_paw'; did you mean 'l_hip'? known: pelvis, chest")
    ):
        apply_override(found, skeleton, {"l_paw": "LeftHand"})
    with pytest.raises(MatchError, match=re.escape("l_hand: unknown joint 'LHand'; known: Hips, LeftUpLeg")):
        apply_override(found, skeleton, {"l_hand": "LHand"})
    with pytest.raises(MatchError, match="l_hand: no joint"):
        apply_override(found, skeleton, {"l_hand": []})


@needs_shared
def test_keypoints_are_placed_at_the_mean_of_their_joints():
    capture = capture_of("soma30_derived/soma30_walk_then_sneak")
    recognition = recognise(capture.skeleton, capture.positions)
    assert recognition.keypoints == KEYPOINTS
    placed = recognition.place(capture.positions)
    hips = [capture.skeleton.names.index(name) for name in ("LeftLeg", "RightLeg")]
    assert placed.shape == (len(capture.positions), len(KEYPOINTS), 3)
    assert placed[:, 0] == pytest.approx(capture.positions[:, hips].mean(axis=1))


@pytest.mark.parametrize(
    ("name", "side", "part"),
    [
        ("Bip01 L Thigh", "l", "hip"), ("mixamorig:RightForeArm", "r", "elbow"), ("lShldr", "l", "shoulder"),
        ("LHipJoint", "l", "helper"), ("upperarm_twist_01_r", "r", "helper"), ("thigh_l", "l", "hip"),
        ("J_Bip_R_UpperLeg", "r", "hip"), ("KneeLeft", "l", "knee"), ("rightfoot", "r", "ankle"), ("lhand", "l", "hand"),
        ("LEFTARM", "l", "shoulder"), ("lowerarm01.L", "l", "elbow"), ("左ひざ", "l", "knee"), ("右足首", "r", "ankle"),
        ("m_avg_L_Hip", "l", "hip"), ("rechtes Knie", "r", "knee"), ("LeftHandThumb1", "l", "finger"),
        ("Hu\u0308fte_links", "l", "hip"), ("leg", "", "knee"), ("rib", "", ""), ("Root", "", ""),
    ],
)  # fmt: skip
def test_a_name_is_taken_apart_into_side_and_part(name, side, part):
    found = name_evidence(name)
    assert found.side == side
    assert (part in found.parts) if part else not found.parts


def test_a_body_of_one_point_is_refused():
    with pytest.raises(MatchError, match="no two legs"):
        recognise(Skeleton(("a", "b", "c"), np.array([-1, 0, 0]), np.zeros((3, 3))), np.zeros((4, 3, 3)))


LEVEL = STANDING | {"chest": (0, 0, 1.46), "neck": (0.01, 0, 1.5)}
"""A thorax between the shoulders and a little over them, as Human3.6M and mocopi have it."""


@pytest.mark.parametrize(("lower", "hub"), [("Spine", "Thorax"), ("torso_6", "torso_7")])
def test_a_thorax_level_with_the_shoulders_is_the_chest_and_not_the_spine_below(lower, hub):
    tree = {
        {"chest": hub}.get(name, name): (part, {"chest": hub, "pelvis": "pelvis"}.get(parent, parent))
        for name, (part, parent) in PLAIN.items()
    }
    tree = {"pelvis": tree.pop("pelvis"), lower: ("spine", "pelvis"), hub: ("chest", lower)} | tree
    tree[hub] = ("chest", lower)
    for name in ("{}_clavicle",):
        del tree[name]
    tree["{}_shoulder"] = ("shoulder", hub)
    skeleton, pose, _ = body(tree, ("left", "right"), LEVEL)
    assert joints_of(recognise(skeleton, pose), skeleton)["chest"] == (hub,)


def test_of_swapped_legs_and_right_arms_the_legs_alone_are_named():
    skeleton, pose, _ = body(PLAIN, ("left", "right"))
    other = {"left": "right", "right": "left"}
    legs = ("hip", "knee", "ankle", "toe")

    def swap(name: str) -> str:
        side, _, part = name.partition("_")
        return f"{other[side]}_{part}" if part in legs else name

    swapped = replace(skeleton, names=tuple(map(swap, skeleton.names)))
    assert "Names of left and right legs are swapped" in " ".join(recognise(swapped, pose).notes)
    assert joints_of(recognise(swapped, pose), swapped)["l_hand"] == ("left_hand",)


@pytest.mark.parametrize("seed", range(4))
def test_a_body_whose_bones_change_their_length_as_a_depth_camera_sees_them_is_recognised(seed: int) -> None:
    """Every bone of a standing body varies by a fifth of its length from frame to frame."""
    skeleton, still, _ = body(*BODIES["Vicon, two wrappers"])
    rigid = recognise(skeleton, still)
    scale = 1 + 0.2 * np.random.default_rng(seed).standard_normal((60, len(skeleton), 1))
    x = np.repeat(still, 60, axis=0)
    for joint in np.flatnonzero(skeleton.parents >= 0):
        parent = skeleton.parents[joint]
        x[:, joint] = x[:, parent] + scale[:, joint] * (still[:, joint] - still[:, parent])
    assert joints_of(recognise(skeleton, x), skeleton) == joints_of(rigid, skeleton)
