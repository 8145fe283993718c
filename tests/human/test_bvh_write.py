"""What is written as BVH is read back as it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_files import SHARED, needs_shared

from robot_retarget.base.errors import OutputError
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.bvh import read_bvh, write_bvh
from robot_retarget.human.skeleton import Skeleton, backward, forward

TO_FILE = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""z up to y up."""


def random_motion(seed: int, joints: int, frames: int, moving: bool) -> Motion:
    """A random tree with random bones that turn at random; some joints also move in their parents."""
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(-1 if joint == 3 else 0, joint)) for joint in range(1, joints))])
    offsets = rng.normal(0, 0.3, (joints, 3))
    translations = np.tile(offsets, (frames, 1, 1))
    translations[:, parents < 0] = rng.normal(0, 2, (frames, int((parents < 0).sum()), 3))
    if moving:
        translations[:, joints - 1] += np.linalg.norm(offsets[-1]) * rng.normal(0, 0.1, (frames, 3))
    turns = rng.normal(size=(frames, joints, 4))
    turns /= np.linalg.norm(turns, axis=2, keepdims=True)
    positions, rotations = forward(parents, translations, turns)
    return Motion(Skeleton(tuple(f"joint {k}" for k in range(joints)), parents, offsets), positions, rotations, 47.0)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 6), st.booleans())
def test_any_motion_comes_back(tmp_path_factory, seed, joints, frames, moving):
    motion = random_motion(seed, joints, frames, moving)
    path = tmp_path_factory.mktemp("round") / "trip.bvh"
    write_bvh(motion, path)
    back = read_bvh(path)
    assert back.notes == ()
    order = [back.skeleton.names.index(name) for name in motion.skeleton.names]
    assert back.positions[:, order] / 100 == pytest.approx(motion.positions @ TO_FILE.T, abs=1e-6)
    assert back.rotations is not None and motion.rotations is not None
    turns, wanted = (
        Rotation.from_quat(values.reshape(-1, 4), scalar_first=True).as_matrix()
        for values in (back.rotations[:, order], motion.rotations)
    )
    assert turns == pytest.approx(TO_FILE @ wanted @ TO_FILE.T, abs=1e-6)
    assert back.fps == pytest.approx(47)


@needs_shared
@pytest.mark.parametrize(
    "clip",
    [
        "mixamo/test_freebvh_walk",
        "fair1_zup/dab",
        "soma30_derived/soma30_walk_then_sneak",
        "makehuman_zup/mh_tpose_173j",
    ],
)
def test_a_real_clip_comes_back_in_metres_and_z_up(tmp_path, clip):
    motion = read_motion(SHARED / "motions" / "bvh" / f"{clip}.bvh")
    write_bvh(motion, tmp_path / "back.bvh")
    back = read_motion(tmp_path / "back.bvh")
    order = [back.skeleton.names.index(name) for name in motion.skeleton.names]
    assert back.positions[:, order] == pytest.approx(motion.positions, abs=1e-6)
    assert "End Site" in (tmp_path / "back.bvh").read_text() or not any(
        n.endswith("_end") for n in motion.skeleton.names
    )


def test_positions_alone_come_back_alone(tmp_path):
    positions = np.random.default_rng(1).normal(size=(5, 4, 3))
    motion = Motion(
        Skeleton(("a", "b", "b_end", "c"), np.array([-1, 0, 1, 0]), np.zeros((4, 3))), positions, None, 30.0
    )
    write_bvh(motion, tmp_path / "points.bvh")
    back = read_bvh(tmp_path / "points.bvh")
    assert back.rotations is None
    assert back.skeleton.names == motion.skeleton.names
    assert back.positions / 100 == pytest.approx(positions @ TO_FILE.T, abs=1e-6)


def test_nothing_is_left_where_nothing_can_be_written(tmp_path):
    with pytest.raises(OutputError, match="cannot write"):
        write_bvh(random_motion(0, 3, 2, False), tmp_path / "no folder" / "clip.bvh")
    assert list(tmp_path.iterdir()) == []


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_poses_in_the_parents_and_in_the_world_are_inverse(seed, joints):
    motion = random_motion(seed, joints, 3, True)
    assert motion.rotations is not None
    parents = motion.skeleton.parents
    positions, rotations = forward(parents, *backward(parents, motion.positions, motion.rotations))
    assert positions == pytest.approx(motion.positions, abs=1e-9)
    assert np.abs(np.einsum("tjk,tjk->tj", rotations, motion.rotations)) == pytest.approx(1)
