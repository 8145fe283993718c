"""Every frame knows its time in the file it came from."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from shared_files import ROOT, SHARED, needs_shared

import robot_retarget as rr

WALK = ROOT / "samples/walk.bvh"
LEAD_IN = SHARED / "motions/bvh/cmu_cgspeed_motionbuilder/walk_01_mixed_eol.bvh"  # its first frame is a T-pose


def test_a_part_of_a_clip_keeps_the_times_of_the_file() -> None:
    walk = rr.read_motion(WALK)
    part = walk.frames(60, 90)
    np.testing.assert_allclose(part.source_time, np.arange(60, 90) / walk.fps)
    np.testing.assert_allclose(part.frames(10).source_time, np.arange(70, 90) / walk.fps)


@pytest.mark.parametrize("fps", [10.0, 23.0, 120.0])
def test_resampling_a_part_keeps_the_time_of_its_first_frame(fps: float) -> None:
    walk = rr.read_motion(WALK)
    part = walk.frames(60, 90).resample(fps)
    np.testing.assert_allclose(part.source_time, 60 / walk.fps + np.arange(len(part)) / fps)


def test_a_motion_is_found_again_by_source_times() -> None:
    walk = rr.read_motion(WALK)
    part = walk.frames(60, 90)
    np.testing.assert_allclose(part.at_source_time(part.source_time, walk.fps).positions, part.positions, atol=1e-9)
    np.testing.assert_allclose(walk.at_source_time(part.source_time, walk.fps).positions, part.positions, atol=1e-9)


@needs_shared
def test_dropped_lead_in_frames_are_counted() -> None:
    motion = rr.read_motion(LEAD_IN)
    assert any("The first frame is a calibration pose" in note for note in motion.notes)
    assert motion.source_time[0] == pytest.approx(1 / motion.fps)


def test_a_motion_carries_the_hash_of_its_file_through_cuts_and_resampling() -> None:
    walk = rr.read_motion(WALK)
    assert walk.source_sha256 == hashlib.sha256(WALK.read_bytes()).hexdigest()
    assert walk.frames(60, 90).resample(20.0).source_sha256 == walk.source_sha256


def test_a_trajectory_of_a_part_has_the_times_and_the_hash_of_the_file(tmp_path: Path) -> None:
    walk = rr.read_motion(WALK)
    graph = rr.describe(walk.frames(60, 66), rr.load_robot("op3"))
    made = rr.solve(graph, balance="off").trajectory
    np.testing.assert_allclose(made.source_time, np.arange(60, 66) / walk.fps, atol=1e-9)
    kept = rr.load_trajectory(made.save(tmp_path / "t.npz"))
    assert kept.source_sha256 == walk.source_sha256
