"""What a batch does and leaves undone: outputs, resuming, changes, failures, bad input."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_batches import contents, cut_clips, job_of, pretend, rows_of, run
from typer.testing import CliRunner

import robot_retarget as rr
from robot_retarget.base.errors import OutputError, UsageError
from robot_retarget.tools.batch.manifest import Manifest
from robot_retarget.tools.batch.run import find_clips
from robot_retarget.tools.batch.task import Settings, Shard
from robot_retarget.tools.cli import app


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut_clips(tmp_path_factory.mktemp("clips"))


@pytest.fixture(scope="module")
def done(clips: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of an undisturbed run, a format and mirror images with it."""
    out = tmp_path_factory.mktemp("done") / "out"
    run(job_of(clips, out, settings=Settings(formats=("csv",), mirror=True)))
    return out


def command(*arguments: object) -> tuple[int, str]:
    """Exit code and output, of a user's mistake its sentence, as the console has it."""
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    if isinstance(result.exception, rr.RobotRetargetError):
        return 2, str(result.exception)
    return result.exit_code, result.output


def test_every_clip_has_a_trajectory_and_a_score(done: Path) -> None:
    rows = rows_of(done)
    assert [(row.clip, row.state) for row in rows] == [("clap", "done"), ("walk", "done"), ("wave", "done")]
    robot = rr.load_robot("op3")
    for row in rows:
        trajectory = rr.load_trajectory(done / "op3" / f"{row.clip}.npz", robot)
        assert len(trajectory) == row.frames
        assert row.figures["limb_deg_mean"] < 20


def test_formats_and_mirror_images_hold_the_same_motion(done: Path) -> None:
    robot = rr.load_robot("op3")
    own = rr.load_trajectory(done / "op3/wave.npz", robot)
    csv = rr.load_trajectory(done / "op3-csv/wave.csv", robot)
    np.testing.assert_allclose(csv.qpos, own.qpos, atol=1e-9)
    image = rr.load_trajectory(done / "op3/wave_mirror.npz", robot)
    a, b = (rr.score(t, robot).figures for t in (own, image))
    assert b["speed_p99"] == pytest.approx(a["speed_p99"], abs=0.02)
    assert not np.allclose(image.qpos, own.qpos)


def test_a_run_that_is_stopped_and_continued_equals_an_undisturbed_one(clips: Path, done: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out", settings=Settings(formats=("csv",), mirror=True))
    first, _ = run(job, stop_after=1)
    assert first.stopped
    second, reported = run(job)
    assert not second.stopped and len(reported) == 2
    assert contents(job.out) == contents(done)


def test_what_is_done_is_not_done_again(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    assert run(job, pretend)[1] == []


def test_a_changed_clip_changed_settings_and_a_lost_output_are_done_again(tmp_path: Path) -> None:
    clips = cut_clips(tmp_path / "clips")
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    text = (clips / "wave.bvh").read_text()
    (clips / "wave.bvh").write_text(text + "\n")
    assert [outcome.clip for outcome in run(job, pretend)[1]] == ["wave"]
    (job.out / "op3/clap.npz").unlink()
    assert [outcome.clip for outcome in run(job, pretend)[1]] == ["clap"]
    other = replace(job, settings=Settings(preset="directions"))
    assert len(run(other, pretend)[1]) == 3


def test_shards_cover_every_clip_once(clips: Path, tmp_path: Path) -> None:
    found = [
        row.clip
        for k in range(2)
        for row in (run(job_of(clips, tmp_path / f"{k}", shard=Shard(k, 2)), pretend), rows_of(tmp_path / f"{k}"))[1]
    ]
    assert sorted(found) == ["clap", "walk", "wave"]


def test_merged_shards_equal_one_run(clips: Path, done: Path, tmp_path: Path) -> None:
    settings = Settings(formats=("csv",), mirror=True)
    for k in range(2):
        run(job_of(clips, tmp_path / f"{k}", shard=Shard(k, 2), settings=settings))
    code, _ = command("batch", "merge", tmp_path / "0", tmp_path / "1", "--out", tmp_path / "all")
    assert code == 0
    assert contents(tmp_path / "all") == contents(done)


def test_a_clip_that_cannot_be_read_is_listed_and_the_rest_done(tmp_path: Path) -> None:
    clips = cut_clips(tmp_path / "clips", ("wave",))
    (clips / "bad.bvh").write_text("HIERARCHY broken")
    out = tmp_path / "out"
    ended, _ = run(job_of(clips, out))
    assert ended.states == {"done": 1, "failed": 1}
    assert "expected MOTION" in ended.failures[0].message
    code, said = command("batch", clips, "-r", "op3", "--out", out, "--pictures", "0")
    assert code == 1 and "bad" in said and "expected MOTION" in said
    assert run(job_of(clips, out), pretend)[1] == []
    assert [outcome.clip for outcome in run(job_of(clips, out, retry=("failed",)), pretend)[1]] == ["bad"]


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    code, said = command("batch", tmp_path / "none", "-r", "op3", "--out", tmp_path / "out")
    assert code == 2 and "no motion files below" in said and ".bvh" in said


def test_a_folder_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    code, said = command("batch", tmp_path / "none", "-r", "op3", "--out", tmp_path / "out")
    assert code == 2 and "no folder" in said


def test_clips_that_differ_in_their_suffix_keep_it_and_clips_of_one_name_are_refused(tmp_path: Path) -> None:
    one, two = cut_clips(tmp_path / "a", ("wave",)), cut_clips(tmp_path / "b", ("wave",))
    np.savez(one / "wave.npz", positions=np.zeros((3, 17, 3)))
    assert [clip.name for clip in find_clips([one])] == ["wave.bvh", "wave.npz"]
    with pytest.raises(UsageError, match=r"two clips of one name, wave\.bvh: .*a/wave\.bvh and .*b/wave\.bvh"):
        find_clips([one, two])
    assert [clip.name for clip in find_clips([tmp_path], exclude=("a/*",))] == ["b/wave"]


def test_a_folder_of_other_results_is_refused_and_left_as_it_is(clips: Path, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("{}")
    code, said = command("batch", clips, "-r", "op3", "--out", tmp_path)
    assert code == 2 and "is not a batch folder" in said
    assert [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_two_runs_do_not_work_in_one_folder(clips: Path, tmp_path: Path) -> None:
    from robot_retarget.tools.batch.manifest import locked_folder

    with (
        locked_folder(tmp_path / "out"),
        pytest.raises(OutputError, match="another run is at work"),
        locked_folder(tmp_path / "out"),
    ):
        pass


def test_lines_of_the_index_that_are_cut_off_are_passed_over_and_their_clips_repeated(
    clips: Path, tmp_path: Path
) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    whole = (job.out / "index.jsonl").read_bytes()
    (job.out / "index.jsonl").write_bytes(b'[1]\n{"robot": 3}\n' + whole[:-9])
    assert [outcome.clip for outcome in run(job, pretend)[1]] == ["wave"]
    assert (job.out / "index.jsonl").read_bytes() == whole


def test_a_later_row_of_a_clip_replaces_the_earlier_one(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    rows = rows_of(job.out)
    Manifest(job.out).put(replace(rows[1], message="again"))
    assert rows_of(job.out) == [rows[0], replace(rows[1], message="again"), rows[2]]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused(clips: Path, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    code, said = command("batch", clips, "-r", "op3", "--out", tmp_path / "out")
    tmp_path.chmod(0o700)
    assert code == 2 and "cannot make the folder" in said


def test_an_output_that_cannot_be_written_ends_the_run_and_keeps_what_is_done(clips: Path, tmp_path: Path) -> None:
    """A file where the robot's folder should be stands for any failure to write, such as a full disk."""
    job = job_of(clips, tmp_path / "out")
    run(job, stop_after=1)
    blocked = replace(job, settings=replace(job.settings, formats=("csv",)))
    (job.out / "op3-csv").write_text("in the way")
    with pytest.raises(OutputError, match="run it again to continue"):
        run(blocked)
    assert [row.state for row in rows_of(job.out)] == ["done"]
    (job.out / "op3-csv").unlink()
    ended, _ = run(blocked)
    assert ended.states == {"done": 3}


def test_a_robot_that_is_not_there_is_refused_before_any_work(clips: Path, tmp_path: Path) -> None:
    code, said = command("batch", clips, "-r", "no_such_robot", "--out", tmp_path / "out")
    assert code == 2 and "no_such_robot" in said


def test_unknown_formats_and_shards_are_refused(clips: Path, tmp_path: Path) -> None:
    for option, value, expected in (
        ("--format", "nothing", "known:"),
        ("--pack", "nothing", "locomujoco"),
        ("--shard", "3/2", "I from 0 to N - 1"),
        ("--retry", "nothing", "timeout"),
    ):
        code, said = command("batch", clips, "-r", "op3", "--out", tmp_path / "out", option, value)
        assert code == 2 and expected in said


def test_a_dry_run_writes_nothing_and_says_how_much_is_to_do(clips: Path, tmp_path: Path) -> None:
    code, said = command("batch", clips, "-r", "op3", "--out", tmp_path / "out", "--dry-run", "--json")
    assert code == 0 and not (tmp_path / "out").exists()
    facts = json.loads(said)
    assert facts == {"tasks": 3, "kept": 0, "outdated": 0}


def test_a_format_that_is_asked_for_later_is_written_without_solving_again(
    clips: Path, done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = job_of(clips, tmp_path / "out")
    run(plain)
    before = {row.key: row for row in rows_of(plain.out)}
    monkeypatch.setattr("robot_retarget.solver.pipeline.retarget", None)
    later = replace(plain, settings=Settings(formats=("csv",), mirror=True))
    _, reported = run(later)
    assert [one.state for one in reported] == ["done"] * 3
    assert {row.key: row for row in rows_of(plain.out)} == before and contents(plain.out) == contents(done)
    assert not run(later)[1]
    (plain.out / "op3-csv/wave.csv").unlink()
    assert [one.clip for one in run(later)[1]] == ["wave"] and contents(plain.out) == contents(done)


def test_a_changed_file_of_frozen_joints_repeats_its_clips(tmp_path: Path) -> None:
    (tmp_path / "bow.npz").write_bytes(b"one")
    digests = [Settings(freeze=(f"waist={tmp_path / 'bow.npz'}",)).digest("robot")]
    (tmp_path / "bow.npz").write_bytes(b"other")
    digests.append(Settings(freeze=(f"waist={tmp_path / 'bow.npz'}",)).digest("robot"))
    assert digests[0] != digests[1]
