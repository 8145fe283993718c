"""A trajectory file keeps what was solved, and is known by its fingerprint."""

import hashlib
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from made_trajectories import wander

from robot_retarget.actuators.goals import Goals
from robot_retarget.base.errors import TrajectoryError
from robot_retarget.robot import load_robot
from robot_retarget.robot.timing import resample
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


def with_goals(trajectory: Trajectory) -> Trajectory:
    angles = np.zeros((round((trajectory.duration + 1.5) * 125) + 1, len(trajectory.joint_names)))
    goals = Goals(angles, 125.0, 1.0, 0.5, "a map")
    return replace(trajectory, source_time=2 + 0.4 * trajectory.source_time, goals=goals)


def test_goals_and_the_times_of_the_source_come_back_from_the_file(tmp_path):
    kept = with_goals(wander(OP3))
    back = load_trajectory(kept.save(tmp_path / "t.npz"))
    assert back.goals is not None and kept.goals is not None
    np.testing.assert_array_equal(back.source_time, kept.source_time)
    np.testing.assert_array_equal(back.goals.angles, kept.goals.angles)
    assert vars(back.goals) | {"angles": 0} == vars(kept.goals) | {"angles": 0}
    assert back.goals.times[0] == -1 and back.goals.duration == pytest.approx(kept.duration + 1.5, abs=1 / 125)


def test_a_file_of_the_first_format_is_read_with_its_own_times(tmp_path):
    path = tmp_path / "old.npz"
    with np.load(wander(OP3).save(tmp_path / "t.npz")) as archive:
        values = {k: v for k, v in archive.items() if k != "source_time"}
    np.savez(path, **{**values, "format_version": np.array(1)})
    old = load_trajectory(path)
    assert old.goals is None
    np.testing.assert_allclose(old.source_time, np.arange(len(old)) / old.fps)


def test_resampling_keeps_the_times_of_the_source_and_drops_the_goals():
    moved = resample(with_goals(wander(OP3)), OP3, 23.0)
    np.testing.assert_allclose(moved.source_time, 2 + 0.4 * np.arange(len(moved)) / 23.0)
    assert moved.goals is None


@pytest.mark.parametrize("key", ["qpos", "fps", "source_time", "goals", "goals_rate", "goals_lead_in", "goals_servos"])
def test_the_fingerprint_covers_every_key(tmp_path, key):
    with np.load(with_goals(wander(OP3)).save(tmp_path / "t.npz")) as archive:
        values = dict(archive)
    changed = values[key] + ("?" if key == "goals_servos" else 1e-9)
    np.savez(tmp_path / "edited.npz", **{**values, key: changed})
    edited = load_trajectory(tmp_path / "edited.npz")
    assert fingerprint(edited) != fingerprint(load_trajectory(tmp_path / "t.npz"))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"source_time": [0.0, 1.0]}, r"source_time must be \(40,\)"),
        ({"source_time": -np.arange(40.0)}, "must not go back"),
        ({"goals": np.zeros((300, 3))}, r"goals must be \(300, 20\), got \(300, 3\)"),
        ({"goals": np.full((300, 20), np.nan)}, "goals is not finite at row 0, column 0"),
        ({"goals": np.zeros((30, 20))}, "not as long as the trajectory and its settling"),
        ({"goals_rate": np.inf}, "goals_rate must be in 1 … 1000"),
        ({"goals_lead_in": None}, "no 'goals_lead_in'"),
    ],
)
def test_times_and_goals_that_do_not_fit_are_refused(tmp_path, wrong, message):
    with np.load(with_goals(wander(OP3)).save(tmp_path / "t.npz")) as archive:
        values = {k: v for k, v in (dict(archive) | wrong).items() if v is not None}
    np.savez(tmp_path / "bad.npz", **values)
    with pytest.raises(TrajectoryError, match=rf"bad\.npz: .*{message}"):
        load_trajectory(tmp_path / "bad.npz")


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
