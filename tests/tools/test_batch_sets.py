"""A set is of one kind: of the clips that are there, as they are there, made with the options of the last run."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from shared_files import ROOT
from small_batches import cut_clips, job_of, pretend, run
from typer.testing import CliRunner

from robot_retarget.base.errors import UsageError
from robot_retarget.tools.batch.manifest import Manifest
from robot_retarget.tools.batch.pool import run_local
from robot_retarget.tools.batch.run import find_clips, plan_of, reason
from robot_retarget.tools.batch.task import Allowance, Job, Settings, Task, robot_of
from robot_retarget.tools.cli import app


@pytest.fixture
def clips(tmp_path: Path) -> Path:
    return cut_clips(tmp_path / "clips")


def todo(job: Job) -> list[str]:
    """The clips that a run would make."""
    return [task.clip for task in plan_of(job, Manifest(job.out)).tasks]


def test_rows_of_other_options_are_not_counted_as_done(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    ended, _ = run(replace(job, settings=Settings(fps=15.0)), pretend, stop_after=1)
    assert ended.stopped and ended.states.total() == 1


def test_a_row_is_current_while_its_clip_and_options_are(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    (clips / "wave.bvh").unlink()
    manifest = Manifest(job.out)
    plan = plan_of(job, manifest)
    assert {row.clip for row in manifest.rows() if plan.is_current(row)} == {"walk", "clap"}
    other = plan_of(replace(job, settings=Settings(fps=15.0)), manifest)
    assert not any(other.is_current(row) for row in manifest.rows())


def test_a_name_of_a_mirror_image_is_refused(clips: Path, tmp_path: Path) -> None:
    shutil.copy(clips / "wave.bvh", clips / "wave_mirror.bvh")
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    with pytest.raises(UsageError, match="would overwrite wave_mirror"):
        run(replace(job, settings=Settings(mirror=True)), pretend)


def test_an_output_that_was_cut_short_is_made_again(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    assert todo(job) == []
    output = tmp_path / "out/op3/wave.npz"
    output.write_bytes(output.read_bytes()[:-7])
    assert todo(job) == ["wave"]


def test_a_changed_part_of_the_robots_file_is_seen(clips: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "models/op3", tmp_path / "robot")
    (tmp_path / "robot/own.xml").write_text('<mujoco model="own"><include file="op3.xml"/></mujoco>')
    job = job_of(clips, tmp_path / "out", robots=(str(tmp_path / "robot/own.xml"),))
    run(job, pretend)
    part = tmp_path / "robot/op3.xml"
    part.write_text(part.read_text().replace('mass="1.34928"', 'mass="1.5"'))
    robot_of.cache_clear()
    assert len(todo(job)) == 3


def test_a_changed_skeleton_beside_an_amc_is_seen(tmp_path: Path) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    (folder / "02_01.amc").write_text(":FULLY-SPECIFIED\n:DEGREES\n1\nroot 0 0 0 0 0 0\n")
    (folder / "02.asf").write_text(":version 1.10\n")
    assert find_clips([folder])[0].files == (folder / "02_01.amc", folder / "02.asf")
    job = job_of(folder, tmp_path / "out")
    run(job, pretend)
    (folder / "02.asf").write_text(":version 1.20\n")
    assert todo(job) == ["02_01"]


def test_motion_files_that_are_not_read_are_named_with_what_to_do(clips: Path, tmp_path: Path) -> None:
    for name, head in (
        ("a.fbx", b"Kaydara FBX Binary"),
        ("b.vmd", b"Vocaloid Motion Data 0002"),
        ("c.mot", b"endheader"),
    ):
        (clips / name).write_bytes(head)
    (clips / "02.asf").write_text(":version 1.10\n")
    plan = plan_of(job_of(clips, tmp_path / "out"), Manifest(tmp_path / "out"))
    assert [path.name for path in plan.unread] == ["a.fbx", "b.vmd", "c.mot"]
    assert "give a.glb" in reason(plan.unread[0])
    with pytest.raises(UsageError, match=r"no motion files that are read below .*FBX is not read\. Convert it"):
        find_clips([clips], exclude=("*.bvh", "b*", "c*"))


def test_linked_folders_are_followed_once(clips: Path, tmp_path: Path) -> None:
    top = tmp_path / "top"
    top.mkdir()
    (top / "linked").symlink_to(clips)
    (clips / "again").symlink_to(top)
    assert [clip.name for clip in find_clips([top])] == ["linked/clap", "linked/walk", "linked/wave"]


def test_a_second_wish_to_stop_is_heard_while_the_last_clips_run(tmp_path: Path) -> None:
    task = Task(str(ROOT / "samples/walk.bvh"), "walk", "op3", "op3", "", str(tmp_path), Settings(balance="static"))
    asked = []

    def stopping() -> bool:
        asked.append(None)
        if len(asked) > 3:
            raise KeyboardInterrupt
        return len(asked) > 1

    with pytest.raises(KeyboardInterrupt):
        run_local([task], Allowance(), lambda outcome: None, stopping, jobs=1)


def test_the_command_says_what_is_left_out_of_the_lists(clips: Path, tmp_path: Path) -> None:
    job = job_of(clips, tmp_path / "out")
    run(job, pretend)
    (clips / "wave.bvh").unlink()
    words = ["batch", clips, "--robot", "op3", "--out", job.out, "--jobs", "1", "--pictures", "0"]
    done = CliRunner().invoke(app, list(map(str, words)), catch_exceptions=False)
    assert "1 rows are not in the lists" in done.stderr
    assert "wave" not in (job.out / "lists/feasible.txt").read_text()
