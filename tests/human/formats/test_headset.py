"""Sessions of headsets: the body is where the SDK puts it, and joints that are not tracked stay with their limb."""

from pathlib import Path

import numpy as np
import pytest
from headset_sessions import isaac_session, performer, poses_of, record, their_schema
from scipy.spatial.transform import Rotation

from robot_retarget.base.errors import MotionError
from robot_retarget.human.capture import Request
from robot_retarget.human.motion import Motion
from robot_retarget.human.read import read_motion
from robot_retarget.human.readers.headset import read

KNEE, ANKLE, FOOT = 4, 7, 10


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    return performer(tmp_path_factory.mktemp("walker"))


def test_a_recorded_session_is_the_motion_that_was_recorded(walker: Motion, tmp_path: Path) -> None:
    path = isaac_session(tmp_path / "a.mcap", [record(poses) for poses in poses_of(walker)])
    read_back = read(path, Request())
    assert read_back.fps == pytest.approx(60, abs=0.01) and read_back.skeleton.names == walker.skeleton.names
    np.testing.assert_allclose(read_back.positions, walker.positions, atol=1e-6)
    assert walker.rotations is not None and read_back.rotations is not None
    np.testing.assert_allclose(np.abs((read_back.rotations * walker.rotations).sum(axis=2)), 1, atol=1e-6)
    motion = read_motion(path)
    np.testing.assert_allclose(
        np.ptp(motion.positions[:, 0], axis=0), np.ptp(walker.positions[:, 0], axis=0), atol=1e-3
    )


def test_joints_that_are_lost_move_with_their_limb_as_stiff_as_they_were(walker: Motion, tmp_path: Path) -> None:
    poses, records = poses_of(walker), []
    for t, frame in enumerate(poses):
        tracked = np.ones(24, bool)
        if t >= 30:
            tracked[[ANKLE, FOOT]] = False
            frame[[ANKLE, FOOT]] = 9.0  # what a headset sends then is no place
        records.append(record(frame, tracked))
    found = read(isaac_session(tmp_path / "a.mcap", records), Request())
    assert found.rotations is not None and any("left_ankle 83 %" in note for note in found.notes)
    x = found.positions
    for joint, parent in ((ANKLE, KNEE), (FOOT, ANKLE)):
        lengths = np.linalg.norm(x[:, joint] - x[:, parent], axis=1)
        np.testing.assert_allclose(lengths, lengths[0], atol=1e-6)
    kept = x[:, KNEE] - walker.positions[:, KNEE]
    np.testing.assert_allclose(kept, 0, atol=1e-6)
    shank = Rotation.from_quat(found.rotations[:, KNEE], scalar_first=True).inv().apply(x[:, ANKLE] - x[:, KNEE])
    np.testing.assert_allclose(shank[30:], np.tile(shank[29], (150, 1)), atol=1e-6)


def test_knees_without_trackers_follow_the_turn_of_the_hips(walker: Motion, tmp_path: Path) -> None:
    tracked = np.ones(24, bool)
    tracked[[4, 5]] = False
    records = [record(frame, tracked) for frame in poses_of(walker)]
    found = read(isaac_session(tmp_path / "a.mcap", records), Request())
    assert np.linalg.norm(found.positions[:, 4] - walker.positions[:, 4], axis=1).max() < 0.02, "the mean body's thigh"


def test_frames_without_a_body_are_gaps_and_a_session_without_one_is_refused(walker: Motion, tmp_path: Path) -> None:
    records = [record(None if 40 <= t < 46 else frame) for t, frame in enumerate(poses_of(walker))]
    found = read(isaac_session(tmp_path / "a.mcap", records), Request())
    assert len(found.positions) == len(walker)
    with pytest.raises(MotionError, match=r"tracked pelvis; it holds hand/left_hand"):
        read(isaac_session(tmp_path / "b.mcap", [record(None)] * 5, topic="hand/left_hand"), Request())


@pytest.mark.parametrize("data", [b"", b"\x0c\0\0\0", record(np.zeros((24, 7)))[:-40], b"\xff" * 64])
def test_a_broken_record_is_an_error_that_names_the_file(data: bytes, walker: Motion, tmp_path: Path) -> None:
    path = isaac_session(tmp_path / "broken.mcap", [record(poses_of(walker)[0]), data])
    with pytest.raises(MotionError, match=r"broken\.mcap"):
        read_motion(path)


def test_the_program_that_records_sessions_reads_the_same_poses(walker: Motion, tmp_path: Path) -> None:
    deviceio = pytest.importorskip("isaacteleop.deviceio", reason="isaacteleop is not installed")
    poses = poses_of(walker)[:20]
    records = [record(frame, np.arange(24) != KNEE) for frame in poses]
    path = isaac_session(tmp_path / "a.mcap", records, schema=their_schema())
    tracker = deviceio.FullBodyTracker()
    with deviceio.ReplaySession.run(deviceio.McapReplayConfig(str(path), [(tracker, "full_body")])) as session:
        for frame in poses:
            session.update()
            joints = tracker.get_body_pose(session).joints
            np.testing.assert_allclose(joints.positions, frame[:, :3], atol=1e-6)
            np.testing.assert_allclose(joints.orientations, frame[:, 3:], atol=1e-6)
            assert np.flatnonzero(np.asarray(joints.is_valid) == 0).tolist() == [KNEE]
