"""A trajectory file keeps what was solved, and is known by its fingerprint."""

import hashlib
import zipfile

import numpy as np
import pytest
from made_trajectories import wander

from robot_retarget.errors import TrajectoryError
from robot_retarget.robot import load_robot
from robot_retarget.trajectory import Trajectory, fingerprint, load_trajectory

OP3 = load_robot("op3")


def test_saving_and_loading_is_the_identity(tmp_path):
    kept = wander(OP3)
    back = load_trajectory(kept.save(tmp_path / "t.npz"))
    np.testing.assert_array_equal(back.qpos, kept.qpos)
    assert (back.fps, back.joint_names, back.robot, back.source) == (
        kept.fps,
        kept.joint_names,
        kept.robot,
        kept.source,
    )


def test_the_fingerprint_of_a_trajectory_is_the_sha256_of_its_file(tmp_path):
    trajectory = wander(OP3)
    path = trajectory.save(tmp_path / "t.npz")
    assert fingerprint(trajectory) == fingerprint(path) == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_trajectory_file_does_not_know_the_hour(tmp_path):
    with zipfile.ZipFile(wander(OP3).save(tmp_path / "t.npz")) as archive:
        assert {member.date_time for member in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_least_change_gives_another_fingerprint():
    trajectory = wander(OP3)
    qpos = trajectory.qpos.copy()
    qpos[-1, -1] = np.nextafter(qpos[-1, -1], 1)
    assert fingerprint(Trajectory(qpos, trajectory.fps, OP3.joint_names, OP3.name)) != fingerprint(trajectory)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused_by_frame_and_column(bad, tmp_path):
    trajectory = wander(OP3)
    qpos = trajectory.qpos.copy()
    qpos[7, 9] = bad
    with pytest.raises(TrajectoryError, match="frame 7, column 9"):
        Trajectory(qpos, 30, OP3.joint_names, "op3")
    path = tmp_path / "bad.npz"
    with np.load(trajectory.save(tmp_path / "t.npz")) as archive:
        np.savez(path, **{**archive, "qpos": qpos})
    with pytest.raises(TrajectoryError, match=r"bad\.npz: qpos is not finite at frame 7, column 9"):
        load_trajectory(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    for read in (load_trajectory, fingerprint):
        with pytest.raises(TrajectoryError, match=r"cannot read .*absent\.npz: No such file"):
            read(tmp_path / "absent.npz")
