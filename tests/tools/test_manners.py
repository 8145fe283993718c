"""Small courtesies: names in any case, notes on what is replaced or does not fit, comments that stay, verdicts before figures."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_trajectories import hold
from shared_files import ROOT
from typer.testing import CliRunner

import robot_retarget as rr
from robot_retarget.actuators.map import load_map, with_zeros
from robot_retarget.base.files import SAMPLES
from robot_retarget.robot import load_robot
from robot_retarget.servo.outcome import PlaybackOptions
from robot_retarget.servo.plan import plain_plan
from robot_retarget.servo.play import play
from robot_retarget.tools.cli import app, console
from robot_retarget.tools.cli.run import filling

OP3 = load_robot("op3")
MAP = ROOT / "models/op3/servos.toml"


def test_a_shipped_name_is_known_in_any_case() -> None:
    assert load_robot("OP3").name == "op3" and load_map("Op3") == load_map("op3")


def test_a_refused_playback_leaves_the_log_of_the_one_before(tmp_path: Path) -> None:
    log = tmp_path / "play.npz"
    log.write_bytes(b"of the playback before")
    with pytest.raises(rr.RobotRetargetError):
        play(plain_plan(hold(OP3, 0.1), load_map("op3")), load_map("op3"), tmp_path / "no port", PlaybackOptions(), log)
    assert log.read_bytes() == b"of the playback before"


def test_replaced_results_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("first", "second"):
        with filling(tmp_path / "out") as filled:
            (filled.path / "report.json").write_text(text)
        told = capsys.readouterr().err
        assert ("replaced the results of an earlier run" in told and "report.json" in told) == (text == "second")


def test_a_folder_takes_the_results_of_one_run_at_a_time(tmp_path: Path) -> None:
    place = tmp_path / "new/out"
    with filling(place) as filled:
        (filled.path / "report.json").write_text("of the first")
        with pytest.raises(rr.RobotRetargetError, match=f"another run is at work in {place}"), filling(place):
            raise AssertionError("it is refused")
    assert {path.name: path.read_text() for path in place.iterdir()} == {"report.json": "of the first"}


def test_a_run_that_fails_removes_only_what_it_wrote(tmp_path: Path) -> None:
    with pytest.raises(rr.RobotRetargetError), filling(tmp_path) as filled:
        (filled.path / "viewer.html").write_text("of this run")
        assert filled.show("viewer.html").read_text() == "of this run"
        (tmp_path / "trajectory.npz").write_text("of another program")
        raise rr.RobotRetargetError("refused")
    assert [path.name for path in tmp_path.iterdir()] == ["trajectory.npz"]


def test_results_are_the_earlier_ones_or_the_new_ones_wherever_a_run_was_killed(tmp_path: Path) -> None:
    """The run is ended before its first, second, … change of the folder; then the next run begins, and fails."""
    earlier = {"trajectory.npz": "earlier", "report.json": "earlier", "video.mp4": "earlier"}
    new, seen = {"trajectory.npz": "new", "report.json": "new", "strip.png": "new"}, list[dict[str, str]]()
    for left in range(40):
        place = tmp_path / str(left)
        place.mkdir()
        for name, text in earlier.items():
            (place / name).write_text(text)
        if not (child := os.fork()):
            with filling(place) as filled:
                for name, text in new.items():
                    (filled.path / name).write_text(text)
                _end_before_change(left)
            os._exit(0)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        with pytest.raises(rr.RobotRetargetError), filling(place):
            raise rr.RobotRetargetError("refused")
        seen.append({path.name: path.read_text() for path in place.iterdir()})
        if ended == 0:
            break
    else:
        raise AssertionError("the run never ended by itself")
    assert len(seen) > 8 and all(found in (earlier, new) for found in seen) and seen[0] == earlier and seen[-1] == new


def _end_before_change(left: int) -> None:
    """End this process at once before one more change of files than `left`."""

    def watch(event: str, args: tuple[object, ...]) -> None:
        nonlocal left
        writes = event == "open" and isinstance(args[2], int) and args[2] & (os.O_WRONLY | os.O_RDWR)
        if writes or event in ("os.rename", "os.remove", "os.rmdir", "shutil.rmtree"):
            left -= 1
            if left < 0:
                os._exit(9)

    sys.addaudithook(watch)


@pytest.mark.parametrize(("source", "noted"), [("wave.bvh", True), ("clap.bvh", False)])
def test_scoring_against_another_motion_is_noted(source: str, noted: bool, tmp_path: Path) -> None:
    clip, own = ROOT / "samples/clap.bvh", rr.read_motion(ROOT / "samples" / source)
    replace(hold(OP3, 0.2), source=source, source_sha256=own.source_sha256).save(tmp_path / "moves.npz")
    words = ["score", tmp_path / "moves.npz", "--robot", "op3", "--motion", clip]
    done = CliRunner().invoke(app, list(map(str, words)), catch_exceptions=False)
    assert done.exit_code == 0 and ("their contents differ" in done.stderr) == noted


def test_new_zeros_leave_every_other_line_of_a_map(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    shutil.copy(MAP, path)
    before = load_map(path)
    moved = replace(before, servos=(replace(before.servos[0], zero=2051), *before.servos[1:]))
    text = with_zeros(path, moved)
    added = set(text.splitlines()) - set(path.read_text().splitlines())
    assert len(added) == 1 and "2051" in added.pop()
    assert [line for line in text.splitlines() if "#" in line] == [
        line for line in path.read_text().splitlines() if "#" in line
    ]
    path.write_text(text)
    assert load_map(path) == moved


def test_a_verdict_comes_before_figures_and_kept_limits_are_only_counted(capsys: pytest.CaptureFixture[str]) -> None:
    shaken = hold(OP3, 1.0)
    qpos = np.array(shaken.qpos)
    qpos[:, OP3.qpos_index[0]] += 0.3 * (np.arange(len(qpos)) % 2)
    console.show_report(rr.simulate(replace(shaken, qpos=qpos), OP3, others=False))
    told = capsys.readouterr().out.splitlines()
    order = [
        next(k for k, line in enumerate(told) if word in line)
        for word in ("verdict:", "Exceeded", "limits kept", "Figures")
    ]
    assert order == sorted(order)
    assert sum("at most" in line for line in told) == 1


def test_the_shell_can_complete_commands() -> None:
    assert "--install-completion" in CliRunner().invoke(app, ["--help"]).stdout


def test_names_from_files_cannot_control_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    name = "joint\x1b[2J\x9b31m[red]"
    console.say(name)
    console.table(name, ("joint",), [(name,)])
    console.note(name)
    printed = "".join(capsys.readouterr())
    assert printed.count("joint") == 5 and "[red]" in printed
    assert all(c.isprintable() or c == "\n" for c in printed)


def test_a_full_device_behind_standard_output_is_a_sentence_and_exit_2() -> None:
    command = [sys.executable, "-m", "robot_retarget", "info", str(SAMPLES / "wave.bvh")]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 2 and "cannot write" in ended.stderr and "No space left" in ended.stderr
