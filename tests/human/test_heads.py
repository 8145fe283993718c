"""Heads look where the source's heads look, wherever that is on the whole."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.arrays import Floats
from robot_retarget.base.files import SAMPLES
from robot_retarget.human.features import features_of
from robot_retarget.human.match import match
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.robot import load_robot


def own_and_frame(motion: Motion, robot: str = "op3") -> tuple[Rotation, Floats]:
    """The rotations of the joint that is the head, and the frames (T, 3, 3) that are read from them."""
    matched = match(motion, load_robot(robot))
    assert motion.rotations is not None
    own = Rotation.from_quat(motion.rotations[:, matched.recognition.marks["head"].joints[0]], scalar_first=True)
    return own, features_of(motion, matched).segments["head"]


@pytest.mark.parametrize("clip", ["walk", "wave", "hips_and_bow"])
@pytest.mark.parametrize("turn", [[0, 0, 0.8], [0, 0, -0.8], [0.7, 0, 0], [0, 0.6, 0.3]])
def test_a_head_that_looks_aside_throughout_is_not_taken_to_look_ahead(clip: str, turn: list[float]) -> None:
    """Nothing in the motion tells it from one whose joint has its axes turned; the rest pose does."""
    motion = read_motion(SAMPLES / f"{clip}.bvh")
    own, ahead = own_and_frame(motion)
    head, rotations = motion.skeleton.names.index("Head"), np.array(motion.rotations)
    rotations[:, head] = (own * Rotation.from_rotvec(turn)).as_quat(scalar_first=True)
    _, aside = own_and_frame(replace(motion, rotations=rotations))
    assert np.allclose(aside, (own * Rotation.from_rotvec(turn) * own.inv()).as_matrix() @ ahead, atol=1e-6)


def test_without_a_rest_pose_a_head_looks_ahead_on_the_whole() -> None:
    motion = read_motion(SAMPLES / "walk.bvh")
    bare = replace(motion, skeleton=replace(motion.skeleton, offsets=np.zeros_like(motion.skeleton.offsets)))
    assert np.allclose(own_and_frame(bare)[1], own_and_frame(motion)[1])


@needs_shared
def test_clips_of_one_exporter_have_heads_of_one_kind() -> None:
    """A zombie's head hangs throughout: it is no other head than a walker's."""
    constants = []
    for clip in ("mh_walk1", "mh_zombieWalk1"):
        own, frame = own_and_frame(read_motion(SHARED / f"motions/bvh/makehuman_zup/{clip}.bvh"))
        constants.append(own.as_matrix()[0].T @ frame[0])
    assert np.allclose(*constants, atol=1e-6)


EVERYONE = pytest.mark.parametrize(
    "clip",
    [
        "mixamo/test_freebvh_walk",
        "soma30_derived/soma30_pick_up_from_ground",
        "humanik_generic/walk01_ot",
        "fair1_zup/dab",
    ],
)


@needs_shared
@EVERYONE
@pytest.mark.parametrize("name", ["booster_t1", "toddlerbot_2xc"])
def test_where_a_human_looks_is_the_same_for_every_robot(clip: str, name: str) -> None:
    """However far before its neck a robot has its head."""
    motion = read_motion(SHARED / f"motions/bvh/{clip}.bvh")
    looks = [own_and_frame(motion, robot)[1][:, :, 0] for robot in ("op3", str(SHARED / f"robots/{name}/{name}.xml"))]
    assert (np.einsum("ti,ti->t", *looks) > np.cos(0.05)).all()


@needs_shared
@EVERYONE
@pytest.mark.parametrize("name", ["op3", "booster_t1", "toddlerbot_2xc"])
def test_a_head_of_positions_alone_looks_neither_up_nor_down_on_the_whole(clip: str, name: str) -> None:
    """A neck leans as its skeleton is built, and another skeleton's otherwise."""
    motion = replace(read_motion(SHARED / f"motions/bvh/{clip}.bvh"), rotations=None)
    robot = load_robot(name if name == "op3" else str(SHARED / f"robots/{name}/{name}.xml"))
    frames = features_of(motion, match(motion, robot)).segments
    nod = np.einsum("ti,ti->t", frames["head"][:, :, 0], frames["chest"][:, :, 2])
    assert abs(np.median(nod)) < 0.25
